# SPDX-License-Identifier: Apache-2.0
"""An identification for whoever works in Python: printed, drawn, saved, and the device that it found."""

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
        One or several.
    close_loop
        Whether to search for physical effects that the model lacks.
    area
        About how large either piston is [m^2]; by default what makes a measured force.
    geometric_factor
        Contact force over piston force, from the linkage [-]; by default it counts as a part of the area.
    per_setpoint
        Whether to fit a table of operating points beside the joint fit.
    ambient_pressure
        What gauge pressures are counted from, as the recordings were read [Pa].
    fractions
        Shares of train, validation and test.
    core
        `linear`: the paper's equations; `physical`: those before they were linearised; `auto`: what closing the loop
        finds the recordings to need.
    tolerance
        Errors that do not matter, `300Pa`, `2N` or `1%` of the span, or some of these: what is left within it makes no
        verdict `unexplained`.

    Raises
    ------
    InputError
        If a recording is none, holds no motion or too few samples, or a cylinder tells no parameter.

    """
    sizes = tolerance_from([tolerance] if isinstance(tolerance, str) else tolerance)
    options = Options(per_setpoint, fractions, ambient_pressure, close_loop, area, geometric_factor, core, sizes)
    check_type('recordings', recordings, (Iterable, Recording, Path), 'a recording or a list of recordings')
    given: list[Any] = [recordings] if isinstance(recordings, (Recording, str, Path)) else list(recordings)
    for one in given:
        if not isinstance(one, Recording):
            raise InputError(f'identify takes recordings, not {one!r}: read it first, with read_recording')
    return Result(identified(given, options))


class Result:
    """
    What an identification found.

    `print` shows its tables, a notebook its page.

    Attributes
    ----------
    identification : Identification
        All of it: fits, residuals, tests, what was tried.

    """

    def __init__(self, identification: Identification) -> None:
        self.identification = identification

    @lazy_property
    def device(self) -> Device:
        """The device that was identified, with the effects that were found."""
        return identified_device(self.identification)

    @lazy_property
    def _live(self) -> dict[str, PartError]:
        return live_errors(self.identification, self.device)

    @lazy_property
    def recordings(self) -> tuple[Recording, ...]:
        """
        The recordings as they were identified, which `device` simulates with the errors of the report.

        They have no waves of the displacement that no pressure follows, and the set-points that were estimated where
        none were recorded.
        """
        return identified_recordings(self.identification)

    @property
    def report(self) -> dict[str, Any]:
        """What `report.json` holds, see docs/interface.md."""
        return report_data(self.identification, self._live)

    def save(self, folder: Path | str, *, full: bool = False, overwrite: bool = False) -> list[Path]:
        """
        Write `report.json` and `parameters.yaml`, and where the loop was closed `report.html` and `compare.mcap`.

        Parameters
        ----------
        folder
            Where to; made if need be.
        full
            Whether `compare.mcap` holds every sample, however many there are.
        overwrite
            Whether files of these names are replaced that this program did not write.

        Raises
        ------
        InputError
            If the folder can't be written, or a file in it is not to be replaced.

        """
        check_path('folder', folder)
        check_switches(full=full, overwrite=overwrite)
        return write_report(self.identification, Path(folder), full=full, overwrite=overwrite).files

    def plot(self, recording: int = 0) -> list[Axes]:
        """
        Draw what was measured in a recording, what is simulated, and the residual, for each cylinder and the force.

        Returns the axes, two for each of them. In a notebook the picture shows; in a program `matplotlib.pyplot.show()`
        shows it.

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
        """Return what was identified, of which recordings."""
        names = ', '.join(recording.name for recording in self.identification.recordings)
        return f'<Result of {names}: {", ".join(self.identification.channels)}>'

    def __str__(self) -> str:
        """Return the tables, and the verdicts where the loop was closed."""
        return printed(lambda console: print_report(self.identification, console, self._live))

    def _repr_html_(self) -> str:
        """Return the page in a frame, or the tables where the loop was not closed."""
        if not self.identification.closed:
            return f'<pre>{escape(str(self))}</pre>'
        return _FRAME.format(escape(report_page(self.identification, self._live)))
