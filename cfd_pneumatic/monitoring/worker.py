# SPDX-License-Identifier: Apache-2.0
"""A process for diagnoses, so that no callback waits. The process ends together with its parent."""

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

_NICE = 5  # callbacks have priority; the diagnosis must still run on a busy machine
_RESTART_PAUSE = 60.0  # shortest time between two restarts [s]


class Worker:
    """
    Starts a process for diagnoses, which waits for requests.

    The process is started again if it was ended, as Linux does when memory is short: at most once a minute.

    Attributes
    ----------
    restarts
        Number of times that the process was started again.

    """

    def __init__(self) -> None:
        self.restarts = 0
        self._lock = threading.Lock()  # held while a thread uses the process or starts it again
        self._process: subprocess.Popen[Any] | None = None
        self._restarted = -math.inf
        self._reason = ''  # why the process was started again, or cannot be started
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
        """Request a diagnosis; requests run one after another. Without a process the answer fails at once."""
        answer: Future[Finding] = Future()

        def answer_request() -> None:
            with self._lock:
                answer.set_result(self._request_finding(recording, options))

        try:
            # a separate thread, because a write to a full pipe blocks until the process reads
            threading.Thread(target=answer_request, daemon=True).start()
        except RuntimeError as error:  # the system has no more threads
            answer.set_result(_ended_early(f'the diagnosis cannot begin: {error}'))
        return answer

    def _request_finding(self, recording: Recording, options: Options) -> Finding:
        if not self._ensure_started():
            return _ended_early(self.fault or 'the diagnosis process has ended')
        try:
            self._connection.send((recording, options))
            finding: Finding = self._connection.recv()
        except (EOFError, OSError, MemoryError):
            self._kill()
            reason = self._last_reason
            self._ensure_started()
            return _ended_early(f'the diagnosis ended early: its process {reason}')
        return finding

    def restart_if_ended(self) -> None:
        """Start the process again if it has ended while no diagnosis runs."""
        if self._lock.acquire(blocking=False):
            try:
                self._ensure_started()
            finally:
                self._lock.release()

    def _ensure_started(self) -> bool:
        """Start the process again if it has ended and a restart is due; return whether the process runs."""
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
        """Whether the process runs."""
        return self._process is not None and self._process.poll() is None

    @property
    def fault(self) -> str | None:
        """Text on an end of the process within the last minute, or None."""
        seconds = self._seconds_to_restart
        if self.is_running:
            return f'the diagnosis process {self._reason} and was started again' if seconds > 0.0 else None
        next_start = f': the next start is in {seconds:.0f} s' if seconds > 0.0 else ''
        return f'the diagnosis process {self._last_reason}{next_start}'

    @property
    def _last_reason(self) -> str:
        """Why there is no process; valid only without a process."""
        return self._reason if self._process is None else _describe_exit(self._process.returncode)

    @property
    def _seconds_to_restart(self) -> float:
        return self._restarted + _RESTART_PAUSE - time.monotonic()

    @property
    def pid(self) -> int | None:
        """Number of the process."""
        return None if self._process is None else self._process.pid

    def end(self) -> None:
        """End the process at once and for good, even during a diagnosis."""
        self._is_over = True
        self._kill()

    def _kill(self) -> None:
        if self._process is not None:
            self._process.kill()
            self._process.wait()


def _ended_early(reason: str) -> Finding:
    """Return the finding of a diagnosis that ended early and is worth repeating."""
    return Finding({}, reason, ended_early=True)


def _describe_exit(code: int) -> str:
    """Describe how a process ended, by its exit code."""
    return f'was ended by signal {-code} ({signal.strsignal(-code)})' if code < 0 else f'ended with exit code {code}'


def serve(requests_from: int, lifeline: int) -> None:
    """Answer requests from a file descriptor; exit when `lifeline` closes, because the parent has ended."""
    os.nice(_NICE)
    os.environ[LIMIT] = '1'
    logging.getLogger('cfd_pneumatic').setLevel(logging.ERROR)  # the parent already warns of an unused compile cache
    threading.Thread(target=_exit_with_parent, args=(lifeline,), daemon=True).start()
    requests: connection.Connection = connection.Connection(requests_from)
    import_module('cfd_pneumatic.identification.procedure')  # loaded before the first request
    while True:
        try:
            requests.send(_diagnose(*requests.recv()))
        except (EOFError, OSError):
            return


def _diagnose(recording: Recording, options: Options) -> Finding:
    try:
        return diagnose(recording, options)
    except Exception as error:  # an error with a recording must not end the watch
        return Finding({}, f'the diagnosis failed: {type(error).__name__}: {error}')


def _exit_with_parent(lifeline: int) -> None:
    """End the process when its parent has ended, even during a diagnosis."""
    os.read(lifeline, 1)
    os._exit(0)
