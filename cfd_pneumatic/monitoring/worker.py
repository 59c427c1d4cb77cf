"""A process in which the loop is closed, so that no callback waits for it; it ends with the process that started it."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Iterator
from concurrent.futures import Future
from contextlib import contextmanager
from importlib import import_module
from multiprocessing import connection, get_context, parent_process
from multiprocessing.connection import Connection
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
        context = get_context('spawn')  # a fork would take over the middleware's threads and locks, half of them
        self._connection, theirs = context.Pipe()
        self._process = context.Process(target=_serve, args=(theirs,), name='diagnosis', daemon=True)
        with _interrupts_kept_off():
            self._process.start()
        theirs.close()
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
    def pid(self) -> int | None:
        """Number of the process."""
        return self._process.pid

    def end(self) -> None:
        """End the process at once, whatever it is doing."""
        self._process.kill()
        self._process.join()


@contextmanager
def _interrupts_kept_off() -> Iterator[None]:
    """Keep interrupts from a process started meanwhile: one at the terminal reaches the node, which ends it."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _serve(requests: Connection) -> None:
    """Answer requests until there is nobody any more who could ask."""
    os.nice(_NICE)
    os.environ[LIMIT] = '1'
    threading.Thread(target=_end_with_parent, daemon=True).start()
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


def _end_with_parent() -> None:
    """End the process when the one that started it has, even in the middle of something."""
    parent = parent_process()
    if parent is not None:
        connection.wait([parent.sentinel])
        os._exit(0)
