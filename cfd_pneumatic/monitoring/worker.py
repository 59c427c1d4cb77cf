# SPDX-License-Identifier: Apache-2.0
"""A process in which the loop is closed, so that no callback waits for it; it ends with the process that started it."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
from concurrent.futures import Future
from importlib import import_module
from multiprocessing import connection
from typing import TYPE_CHECKING

from cfd_pneumatic.monitoring.finding import Finding, diagnose
from cfd_pneumatic.parallel import LIMIT
from cfd_pneumatic.recording import Recording

if TYPE_CHECKING:
    from cfd_pneumatic.identification import Options

_NICE = 5  # callbacks come first, and yet it is not to starve on a busy machine


class Worker:
    """The process; it starts at once, and waits."""

    def __init__(self) -> None:
        self._connection, theirs = connection.Pipe()
        watched, self._lifeline = os.pipe()
        # a session of its own: an interrupt at the terminal reaches the node, which ends it
        self._process = subprocess.Popen(
            [sys.executable, '-c', f'from {__name__} import serve; serve({theirs.fileno()}, {watched})'],
            pass_fds=(theirs.fileno(), watched),
            start_new_session=True,
        )
        theirs.close()
        os.close(watched)
        self._asking = threading.Lock()

    def diagnose(self, recording: Recording, options: Options) -> Future[Finding]:
        """Have the loop closed on a recording; one after the other."""
        answer: Future[Finding] = Future()

        def ask() -> None:
            try:
                with self._asking:
                    self._connection.send((recording, options))
                    answer.set_result(self._connection.recv())
            except (EOFError, OSError) as error:
                answer.set_result(Finding({}, f'the diagnosis ended early ({error or "its process is gone"})'))

        # its own, because a pipe takes no more than the process reads
        threading.Thread(target=ask, daemon=True).start()
        return answer

    @property
    def pid(self) -> int:
        """Number of the process."""
        return self._process.pid

    def end(self) -> None:
        """End the process at once, whatever it is doing."""
        self._process.kill()
        self._process.wait()


def serve(requests_from: int, lifeline: int) -> None:
    """Answer requests that come through a file descriptor, until another one says that nobody is left to ask."""
    os.nice(_NICE)
    os.environ[LIMIT] = '1'
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
