# SPDX-License-Identifier: Apache-2.0
"""Force along a path in Python: a preview that prints, plots and saves."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cfd_pneumatic.arguments import check_numbers, check_path, check_switches, check_type
from cfd_pneumatic.errors import InputError
from cfd_pneumatic.lazy import lazy_property
from cfd_pneumatic.path.band import PlanErrors
from cfd_pneumatic.path.console import print_preview
from cfd_pneumatic.path.data import preview_data
from cfd_pneumatic.path.files import write_preview
from cfd_pneumatic.path.hold import Regulators
from cfd_pneumatic.path.identified import IdentifiedDevice
from cfd_pneumatic.path.inputs import read_path
from cfd_pneumatic.path.motion import PathMotion, Surface
from cfd_pneumatic.path.preview import Preview, Task, preview_force
from cfd_pneumatic.path.setpoints import SetpointRange
from cfd_pneumatic.terminal import printed

if TYPE_CHECKING:
    from matplotlib.axes import Axes


class ForceOnPath(Preview):
    """Preview of the force along a path; `print` shows the answers."""

    @lazy_property
    def data(self) -> dict[str, Any]:
        """The content of `preview.json`."""
        return preview_data(self)

    def save(self, folder: Path | str, *, overwrite: bool = False) -> list[Path]:
        """
        Write `report.html`, `preview.json`, `schedule.csv` and `preview.mcap` into a folder.

        Parameters
        ----------
        folder
            Output folder. An earlier preview is replaced.
        overwrite
            Whether to replace files of these names that this program did not write.

        Raises
        ------
        InputError
            If the folder cannot be written, or an existing file must not be replaced.

        """
        check_path('folder', folder)
        check_switches(overwrite=overwrite)
        return write_preview(self, Path(folder), overwrite=overwrite)

    def plot(self) -> list[Axes]:
        """
        Plot displacement, force with its band, and held set-points along the path, each on an axes.

        Raises
        ------
        InputError
            If Matplotlib is not installed.

        """
        try:
            from cfd_pneumatic.path.plot import plot_preview
        except ModuleNotFoundError as error:
            raise InputError(f"plot needs Matplotlib ({error.name}): pip install 'cfd_pneumatic[plot]'") from error
        return plot_preview(self)

    def __str__(self) -> str:
        """Return the answers as two columns."""
        return printed(lambda console: print_preview(self, console))

    def __repr__(self) -> str:
        """Return the wanted force and the force error at constant set-points."""
        return f'<ForceOnPath: {self.task.force:g} N, error {self.constant.rms_error:.2g} N (RMS)>'


def force_on_path(
    device: IdentifiedDevice,
    path: Surface | PathMotion | Path | str,
    *,
    force: float,
    feed: float | None = None,
    tolerance: float | None = None,
    bias: float | None = None,
    start: float | None = None,
    scan_error: float = 0.0,
    timing_error: float = 0.0,
    hold: bool = False,
    rate: float = 50.0,
    slew: float | None = None,
    limits: tuple[float, float] | None = None,
    progress: Callable[[str], None] = lambda step: None,
) -> ForceOnPath:
    """
    Predict the contact force along a path, and optionally the set-points that hold it.

    Parameters
    ----------
    device
        The device, with the uncertainty of its identification if known.
    path
        Error of a surface, motion of the piston over time, or a file with one of them.
    force
        Wanted contact force [N].
    feed
        Speed along a surface [m/s].
    tolerance
        Largest accepted force error [N].
    bias
        Mean gauge set-point of two cylinders [Pa]; by default that of the recordings.
    start
        Displacement of the piston where a surface has no error [m]; by default the path is centred in the stroke.
    scan_error
        Standard deviation of the error of the surface [m].
    timing_error
        Standard deviation of the time at which the robot is at a position [s].
    hold
        Whether to compute set-points over time that hold the force.
    rate
        Rate of these set-points [Hz].
    slew
        Largest rate of a set-point [Pa/s]; by default not limited.
    limits
        Lowest and highest gauge set-point of the regulators [Pa]; by default 0 to the supply pressure.
    progress
        Called with the name of each step of the work when the step begins.

    Raises
    ------
    InputError
        If an argument is invalid, the path cannot be read or is outside of the stroke, or the regulators cannot give
        the force.

    """
    check_numbers(force=force, scan_error=scan_error, timing_error=timing_error, rate=rate)
    check_numbers(optional=True, feed=feed, tolerance=tolerance, bias=bias, start=start, slew=slew)
    check_switches(hold=hold)
    if not isinstance(path, (Surface, PathMotion)):
        check_type('path', path, (str, Path), 'a Surface, a PathMotion or the path of a file')
        path = read_path(Path(path))
    low, high = limits or (0.0, device.device.number('supply_pressure'))
    task = Task(
        force=force,
        feed=feed,
        tolerance=tolerance,
        bias=bias,
        start=start,
        errors=PlanErrors(scan_error, timing_error),
        regulators=Regulators(SetpointRange(low, high), rate, slew),
        hold=hold,
    )
    return ForceOnPath(**vars(preview_force(device, path, task, progress)))
