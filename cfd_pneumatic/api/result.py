# SPDX-License-Identifier: Apache-2.0
"""Identification in Python: results to print, plot and save, and the identified device."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cfd_pneumatic.arguments import check_path, check_switches, check_type
from cfd_pneumatic.convention import AMBIENT_PRESSURE
from cfd_pneumatic.device import Device, identified_device, identified_recordings, live_errors
from cfd_pneumatic.errors import InputError
from cfd_pneumatic.identification import AUTO, FRACTIONS, Identification, Options, PartError, tolerance_from
from cfd_pneumatic.identification import identify as identified
from cfd_pneumatic.lazy import lazy_property
from cfd_pneumatic.path import ForceOnPath, IdentifiedDevice, PathMotion, Surface, force_on_path
from cfd_pneumatic.recording import Recording
from cfd_pneumatic.reporting import print_report, report_data, report_page, write_report
from cfd_pneumatic.terminal import printed

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_FRAME = '<iframe srcdoc="{}" style="width: 100%; height: 80vh; border: 1px solid #ccc"></iframe>'


def identify(
    recordings: Recording | Sequence[Recording],
    *,
    close_loop: bool = False,
    area: float | None = None,
    geometric_factor: float | None = None,
    per_setpoint: bool = False,
    ambient_pressure: float = AMBIENT_PRESSURE,
    fractions: tuple[float, float, float] = FRACTIONS,
    core: str = AUTO,
    tolerance: str | Sequence[str] = (),
) -> Result:
    """
    Identify a device from its recordings, jointly.

    Parameters
    ----------
    recordings
        One recording or several recordings of the same device.
    close_loop
        Whether to search for physical effects that the model lacks.
    area
        Approximate area of each piston [m^2]; by default the area that gives the measured force.
    geometric_factor
        Contact force / piston force, from the linkage [-]; by default included in the area.
    per_setpoint
        Whether to fit a table of operating points in addition to the joint fit.
    ambient_pressure
        Absolute ambient pressure with which the recordings were read [Pa].
    fractions
        Shares of train, validation and test.
    core
        `linear`: the paper's equations; `physical`: the equations before linearisation; `auto`: selected by the loop.
    tolerance
        Largest acceptable errors: `300Pa`, `2N` or `1%` of the span, or several of these. A smaller remaining error
        does not give the verdict `unexplained`.

    Raises
    ------
    InputError
        If an item is not a recording, a recording has no motion or too few samples, or a cylinder determines no
        parameter.

    """
    tolerances = tolerance_from([tolerance] if isinstance(tolerance, str) else tolerance)
    options = Options(per_setpoint, fractions, ambient_pressure, close_loop, area, geometric_factor, core, tolerances)
    check_type('recordings', recordings, (Iterable, Recording, Path), 'a recording or a list of recordings')
    items: list[Any] = [recordings] if isinstance(recordings, (Recording, str, Path)) else list(recordings)
    for item in items:
        if not isinstance(item, Recording):
            raise InputError(f'identify takes recordings, not {item!r}. Read the bag first, with read_recording')
    return Result(identified(items, options))


class Result:
    """
    The result of an identification.

    `print` shows the tables; a notebook shows the report page.

    Attributes
    ----------
    identification : Identification
        All results: fits, residuals, tests and candidate effects.

    """

    def __init__(self, identification: Identification) -> None:
        self.identification = identification

    @lazy_property
    def device(self) -> Device:
        """The identified device, with the added effects."""
        return identified_device(self.identification)

    @lazy_property
    def _live(self) -> dict[str, PartError]:
        return live_errors(self.identification, self.device)

    @lazy_property
    def recordings(self) -> tuple[Recording, ...]:
        """
        The recordings as the fit used them; `device` simulates them with the errors of the report.

        Sensor ripple is removed from the displacement, and estimated set-points replace missing ones.
        """
        return identified_recordings(self.identification)

    @property
    def report(self) -> dict[str, Any]:
        """The content of `report.json`; see docs/reference/interface.md."""
        return report_data(self.identification, self._live)

    def save(self, folder: Path | str, *, full: bool = False, overwrite: bool = False) -> list[Path]:
        """
        Write `report.json` and `parameters.yaml`; after a closed loop also `report.html` and `compare.mcap`.

        Parameters
        ----------
        folder
            Folder for the files. A missing folder is created.
        full
            Whether `compare.mcap` holds every sample, regardless of the number.
        overwrite
            Whether files of these names are replaced even if this program did not write them.

        Raises
        ------
        InputError
            If the folder cannot be written, or a file in it must not be replaced.

        """
        check_path('folder', folder)
        check_switches(full=full, overwrite=overwrite)
        return write_report(self.identification, Path(folder), full=full, overwrite=overwrite).files

    def force_on_path(self, path: Surface | PathMotion | Path | str, *, force: float, **options: Any) -> ForceOnPath:
        """
        Predict the contact force of the identified device along a path, and optionally the set-points that hold it.

        Parameters
        ----------
        path
            Error of a surface, motion of the piston over time, or a file with one of them.
        force
            Wanted contact force [N].
        **options
            Options of `Device.force_on_path`: `feed`, `tolerance`, `hold` and others.

        Raises
        ------
        InputError
            If an argument is invalid, the path cannot be read or is outside of the stroke, or the regulators cannot
            give the force.

        """
        return force_on_path(IdentifiedDevice.of_identification(self.identification), path, force=force, **options)

    def plot(self, recording: int = 0) -> list[Axes]:
        """
        Plot measured values, simulated values and residuals of a recording, for each cylinder and the force.

        The method returns two axes for each channel. A notebook shows the plot; a program calls
        `matplotlib.pyplot.show()`.

        Raises
        ------
        InputError
            If Matplotlib is not installed.

        """
        try:
            from cfd_pneumatic.reporting import overview
        except ModuleNotFoundError as error:
            raise InputError(f"plot needs Matplotlib ({error.name}): pip install 'cfd_pneumatic[plot]'") from error
        return overview(self.identification, recording)

    def __repr__(self) -> str:
        """Return the names of the recordings and of the identified channels."""
        names = ', '.join(recording.name for recording in self.identification.recordings)
        return f'<Result of {names}: {", ".join(self.identification.channels)}>'

    def __str__(self) -> str:
        """Return the tables, and the verdicts if the loop was closed."""
        return printed(lambda console: print_report(self.identification, console, self._live))

    def _repr_html_(self) -> str:
        """Return the report page in a frame, or the tables if the loop was not closed."""
        if not self.identification.closed:
            return f'<pre>{escape(str(self))}</pre>'
        return _FRAME.format(escape(report_page(self.identification, self._live, scripts=None)))
