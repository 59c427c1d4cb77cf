# SPDX-License-Identifier: Apache-2.0
"""`identify_bag` in a separate process, and its results."""

from __future__ import annotations

import hashlib
import json
import math
import subprocess
import threading
import time
from collections import deque
from collections.abc import Sequence
from pathlib import Path

from cfd_pneumatic.commands import CHECKSUM_KEY, PROGRESS_KEY
from cfd_pneumatic.device import Device
from cfd_pneumatic.errors import InputError, without_quotations
from cfd_pneumatic.files import read_input
from cfd_pneumatic.reporting import PARAMETER_FILE, REPORT_FILE
from cfd_pneumatic.runtime import BAD_INPUT, start_python

CANCELLED = 'cancelled: earlier outputs are untouched'

_POLL = 0.01  # [s]
_PATIENCE = 1.5  # time for an interrupted fit to end by itself [s]
_KEPT_LINES, _LONGEST_LINE = 20, 4_000  # of the standard error of a fit
_LARGEST = 2**26  # largest file of results [bytes]


class FitProcess:
    """`identify_bag` in a separate process, so that a long fit delays no callback and can be ended at once."""

    def __init__(self, arguments: Sequence[str]) -> None:
        """Start the process with arguments of `identify_bag`."""
        self.step = 'starting'
        self.progress = 0.0
        self._checksum: str | None = None
        self._errors: deque[str] = deque(maxlen=_KEPT_LINES)
        self._kill_at = math.inf
        # an interrupt at the terminal reaches the node, which then ends the fit
        self._process = start_python(
            'from cfd_pneumatic.runtime.start import identify_bag; sys.exit(identify_bag())',
            '--progress=lines',
            *arguments,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            env={'PYTHONUNBUFFERED': '1'},
        )
        readers = (self._read_progress, self._read_errors)
        self._readers = [threading.Thread(target=read, daemon=True) for read in readers]
        for reader in self._readers:
            reader.start()

    def _read_progress(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            progress = json.loads(line)
            self.progress, self.step = progress[PROGRESS_KEY], progress['what']
            self._checksum = progress.get(CHECKSUM_KEY)

    def _read_errors(self) -> None:
        assert self._process.stderr is not None
        self._errors.extend(line.rstrip()[:_LONGEST_LINE] for line in self._process.stderr)

    def has_ended(self) -> bool:
        """Return whether the process has ended; kill a cancelled process that does not end in time."""
        if time.monotonic() > self._kill_at:
            self._process.kill()
            self._process.wait()
        return self._process.poll() is not None

    def failure(self) -> str | None:
        """
        Return why the ended fit failed; None if it succeeded.

        Any node in the graph can read the reason, so the reason quotes no file.
        """
        for reader in self._readers:
            reader.join()
        if self._process.returncode == 0:
            return None
        if self._kill_at < math.inf:
            return CANCELLED
        if self._process.returncode == BAD_INPUT and self._errors:
            return without_quotations(self._errors[-1])
        return (
            f'identify_bag ended unexpectedly with code {self._process.returncode}: '
            'run identify_bag on the same bags in a terminal to see the error'
        )

    def load_results(self, folder: Path) -> tuple[str, Device]:
        """
        Return the report and the device that the fit wrote into a folder.

        Checksums verify that the fit wrote the files: other programs may write into the folder.

        Raises
        ------
        InputError
            If a file is missing or has another checksum.

        """
        text = _read_checked(folder / REPORT_FILE, self._checksum).decode()
        parameters = folder / PARAMETER_FILE
        _read_checked(parameters, json.loads(text)['files'][PARAMETER_FILE])
        return text, Device.load(parameters)

    def cancel(self) -> None:
        """Ask the process to end; outputs are written completely or not at all."""
        if self._kill_at == math.inf:
            self._kill_at = time.monotonic() + _PATIENCE
            self._process.terminate()

    def end(self) -> None:
        """Cancel the process and wait until it has ended."""
        self.cancel()
        while not self.has_ended():
            time.sleep(_POLL)


def _read_checked(path: Path, checksum: str | None) -> bytes:
    """Return the content of a file after a check of its checksum."""
    try:
        content = read_input(path, _LARGEST)
    except InputError as error:
        raise InputError(f'{path} {error}') from error
    if hashlib.sha256(content).hexdigest() != checksum:
        raise InputError(
            f'{path}, a result of this identification, was changed by another program: set output_dir to a folder '
            'that no other program writes to, and identify again'
        )
    return content
