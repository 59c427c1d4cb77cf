# SPDX-License-Identifier: Apache-2.0
"""
Numba's compiler, with machine code kept on disk, or in memory if no folder can be written.

Only one process at a time compiles for a folder. Other processes wait, and then load the code from the folder.
"""

from __future__ import annotations

import fcntl
import gc
import os
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from threading import RLock
from typing import Any

from numba import njit
from numba.core import config
from numba.core.event import Event, Listener, install_listener

from cfd_pneumatic.runtime.compile_cache import CompileCache

config._config_fname = os.devnull  # a settings file in the working folder could name a cache with malicious code
config.reload_config()

LOCK_FILE = 'compiling.lock'
_FIRST_REPORT, _REPORT_INTERVAL = 0.5, 1.0  # reports of waiting; repeated because a listener may start late [s]
_POLL_INTERVAL = 0.02  # between two attempts to lock [s]

_thread_lock = RLock()
_depth = 0  # of nested compilations: a function's compilation also compiles the functions that it calls
_on_waiting: list[Callable[[], None]] = []


def compiler(**options: Any) -> Callable[[Callable[..., Any]], Any]:
    """Return a decorator that compiles a function on its first call, with options of Numba."""
    options['no_cfunc_wrapper'] = True  # no function is passed to another function

    def compiled(function: Callable[..., Any]) -> Any:
        dispatcher = njit(**options)(function)
        dispatcher._cache = cache = CompileCache(function)
        dispatcher.compile = _in_one_process(_vectorizing(dispatcher.compile), cache)
        return dispatcher

    return compiled


def _vectorizing(compile_: Callable[[Any], Any]) -> Callable[[Any], Any]:
    """
    Return a compiler that also runs LLVM's superword vectorisation, which Numba switches off.

    With this pass `propagation` computes several sensitivities at once. Only a setting of the process enables the pass.
    """

    def compile_vectorizing(signature: Any) -> Any:
        usual, config.SLP_VECTORIZE = config.SLP_VECTORIZE, 1  # type: ignore[attr-defined]
        try:
            return compile_(signature)
        finally:
            config.SLP_VECTORIZE = usual  # type: ignore[attr-defined]

    return compile_vectorizing


def _in_one_process(compile_: Callable[[Any], Any], cache: CompileCache) -> Callable[[Any], Any]:
    """Return a compiler that runs in one process at a time; each process first looks into the cache."""

    def compile_locked(signature: Any) -> Any:
        global _depth
        with _thread_lock:
            _depth += 1
            try:
                if _depth > 1 or cache.cache_path is None:
                    return compile_(signature)
                with folder_lock(Path(cache.cache_path)), _garbage_collection_paused():
                    return compile_(signature)
            finally:
                _depth -= 1

    return compile_locked


@contextmanager
def _garbage_collection_paused() -> Iterator[None]:
    """Pause Python's garbage collection, which takes a seventh of a compiler's time and finds little."""
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.enable()


@contextmanager
def folder_lock(folder: Path) -> Iterator[None]:
    """Prevent other processes from compiling for a folder; without effect if the folder cannot be locked."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        file = open(folder / LOCK_FILE, 'wb', opener=_open_lock)  # noqa: SIM115  # closed below
    except OSError:
        yield
        return
    with file:
        with suppress(OSError):  # from a file system without locks
            _lock(file.fileno())
        yield


def _open_lock(path: str, _: int) -> int:
    """
    Open a lock file, without following a link and without waiting for a named pipe in its place.

    Only the user may open the file: a user who can read a file can lock it.
    """
    file = os.open(path, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_NONBLOCK, 0o600)
    with suppress(OSError):  # if the file belongs to another user
        os.fchmod(file, 0o600)  # earlier versions let all users read the file
    return file


def _lock(file: int) -> None:
    """Wait until a file is locked, which lasts until the file is closed; report a long wait each second."""
    due = time.monotonic() + _FIRST_REPORT
    while True:
        try:
            return fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            if time.monotonic() > due:
                due += _REPORT_INTERVAL
                for report in _on_waiting:
                    report()
            time.sleep(_POLL_INTERVAL)


@contextmanager
def announced(report_start: Callable[[str | None], None], report_waiting: Callable[[], None]) -> Iterator[None]:
    """
    Report the first compilation of functions; without a report if their machine code is already kept.

    `report_start` gets the folder for the machine code, or None if the code is in memory only. `report_waiting` is
    called each second in which another process compiles the functions.
    """
    _on_waiting.append(report_waiting)
    try:
        with install_listener('numba:compile', _FirstCompilation(report_start)):
            yield
    finally:
        _on_waiting.remove(report_waiting)


class _FirstCompilation(Listener):
    def __init__(self, report: Callable[[str | None], None]) -> None:
        self._report: Callable[[str | None], None] | None = report

    def on_start(self, event: Event) -> None:
        if self._report is not None:
            report, self._report = self._report, None
            report(event.data['dispatcher'].stats.cache_path)

    def on_end(self, event: Event) -> None:
        """Do nothing at the end of a compilation; Numba requires the method."""
