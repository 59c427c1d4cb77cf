# SPDX-License-Identifier: Apache-2.0
"""A process in which the loop is closed, so that no callback waits for it; it ends with the process that started it."""

from __future__ import annotations

import logging
import math
import os
import signal
import subprocess
import threading
import time
from concurrent.futures import Future
from importlib import import_module
from multiprocessing import connection
from typing import TYPE_CHECKING, Any

from cfd_pneumatic.monitoring.finding import Finding, diagnose
from cfd_pneumatic.recording import Recording
from cfd_pneumatic.runtime import LIMIT, start_python

if TYPE_CHECKING:
    from cfd_pneumatic.identification import Options

_NICE = 5  # callbacks come first, and yet it is not to starve on a busy machine
_PAUSE = 60.0  # the process is started again at most once in this time [s]


class Worker:
    """
    The process; it starts at once, and waits.

    If something ends the process, as Linux does when memory is short, it is started again, at most once a minute.

    Attributes
    ----------
    restarts
        How often it was started again.

    """

    def __init__(self) -> None:
        self.restarts = 0
        self._asking = threading.Lock()  # of the thread that uses the process, or starts it again
        self._process: subprocess.Popen[Any] | None = None
        self._restarted = -math.inf
        self._reason = ''  # why it was started again, or cannot be started
        self._is_over = False
        self._start()

    def _start(self) -> None:
        try:
            self._connection, theirs = connection.Pipe()
            watched, self._lifeline = connection.Pipe(duplex=False)
            with theirs, watched:
                numbers = theirs.fileno(), watched.fileno()
                self._process = start_python(f'from {__name__} import serve; serve(*{numbers})', pass_fds=numbers)
        except OSError as error:
            self._process = None
            self._reason = f'cannot be started ({error.strerror})'
        if self._is_over:
            self.end()

    def diagnose(self, recording: Recording, options: Options) -> Future[Finding]:
        """Have the loop closed on a recording; one after the other. Without a process the answer says so at once."""
        answer: Future[Finding] = Future()

        def ask() -> None:
            with self._asking:
                answer.set_result(self._diagnosed(recording, options))

        try:
            # its own, because a pipe takes no more than the process reads
            threading.Thread(target=ask, daemon=True).start()
        except RuntimeError as error:  # the system has no more threads
            answer.set_result(_early(f'the diagnosis cannot begin: {error}'))
        return answer

    def _diagnosed(self, recording: Recording, options: Options) -> Finding:
        if not self._started():
            return _early(self.fault or 'the diagnosis process has ended')
        try:
            self._connection.send((recording, options))
            finding: Finding = self._connection.recv()
        except (EOFError, OSError, MemoryError):
            self._kill()
            reason = self._last_reason
            self._started()
            return _early(f'the diagnosis ended early: its process {reason}')
        return finding

    def look_after(self) -> None:
        """Start the process again if it has ended while it was idle."""
        if self._asking.acquire(blocking=False):
            try:
                self._started()
            finally:
                self._asking.release()

    def _started(self) -> bool:
        """Return whether the process runs, after starting it again if it has ended and if it is time."""
        if self.is_running or self._is_over:
            return self.is_running
        self._reason = self._last_reason
        if self._seconds_to_restart <= 0.0:
            self._restarted = time.monotonic()
            self.restarts += 1
            self._start()
        return self.is_running

    @property
    def is_running(self) -> bool:
        """Whether the process is there."""
        return self._process is not None and self._process.poll() is None

    @property
    def fault(self) -> str | None:
        """What happened to the process within the last minute, or None."""
        left = self._seconds_to_restart
        if self.is_running:
            return f'the diagnosis process {self._reason} and was started again' if left > 0.0 else None
        again = f': the next start is in {left:.0f} s' if left > 0.0 else ''
        return f'the diagnosis process {self._last_reason}{again}'

    @property
    def _last_reason(self) -> str:
        """Why there is no process; only if there is none."""
        return self._reason if self._process is None else _end_of(self._process.returncode)

    @property
    def _seconds_to_restart(self) -> float:
        return self._restarted + _PAUSE - time.monotonic()

    @property
    def pid(self) -> int | None:
        """Number of the process."""
        return None if self._process is None else self._process.pid

    def end(self) -> None:
        """End the process at once, whatever it is doing, for good."""
        self._is_over = True
        self._kill()

    def _kill(self) -> None:
        if self._process is not None:
            self._process.kill()
            self._process.wait()


def _early(reason: str) -> Finding:
    """Return the finding of a diagnosis that is worth repeating."""
    return Finding({}, reason, ended_early=True)


def _end_of(code: int) -> str:
    """Return how a process ended, by its exit code."""
    return f'was ended by signal {-code} ({signal.strsignal(-code)})' if code < 0 else f'ended with exit code {code}'


def serve(requests_from: int, lifeline: int) -> None:
    """Answer requests that come through a file descriptor, until another one says that nobody is left to ask."""
    os.nice(_NICE)
    os.environ[LIMIT] = '1'
    logging.getLogger('cfd_pneumatic').setLevel(logging.ERROR)  # its node warns of a compile cache that is not used
    threading.Thread(target=_end_with, args=(lifeline,), daemon=True).start()
    requests: connection.Connection = connection.Connection(requests_from)
    import_module('cfd_pneumatic.identification.procedure')  # before it is needed
    while True:
        try:
            requests.send(_diagnose(*requests.recv()))
        except (EOFError, OSError):
            return


def _diagnose(recording: Recording, options: Options) -> Finding:
    try:
        return diagnose(recording, options)
    except Exception as error:  # what a recording makes the loop stumble over must not end the watch
        return Finding({}, f'the diagnosis failed: {type(error).__name__}: {error}')


def _end_with(lifeline: int) -> None:
    """End the process when the one that started it has, even in the middle of something."""
    os.read(lifeline, 1)
    os._exit(0)
