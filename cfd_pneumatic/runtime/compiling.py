# SPDX-License-Identifier: Apache-2.0
"""
Numba's compiler: machine code is kept on disk, or in memory where no folder can be written.

One process at a time compiles what a folder keeps; others that want the same wait, and find it there.
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

config._config_fname = os.devnull  # Numba's settings file in the working folder, which may name a cache with any code
config.reload_config()

_LOCK_FILE = 'compiling.lock'
_AGAIN = 1.0  # after which it is said again: who listens may have come late [s]
_PATIENCE, _PAUSE = 0.5, 0.02  # after which it is said that another process compiles, and between two looks [s]

_own = RLock()
_depth = 0  # a function's compilation asks for that of those that it calls
_waiting: list[Callable[[], None]] = []


def compiler(**options: Any) -> Callable[[Callable[..., Any]], Any]:
    """Return a decorator that compiles a function on its first call, with some options of Numba's."""
    options['no_cfunc_wrapper'] = True  # nothing passes functions to functions

    def compiled(function: Callable[..., Any]) -> Any:
        dispatcher = njit(**options)(function)
        dispatcher._cache = cache = CompileCache(function)
        dispatcher.compile = _alone(_vectorizing(dispatcher.compile), cache)
        return dispatcher

    return compiled


def _vectorizing(compile_: Callable[[Any], Any]) -> Callable[[Any], Any]:
    """
    Let a compiler run a pass of LLVM that Numba leaves out, and that only a setting of the process switches on.

    With it `propagation` carries several sensitivities forward at once.
    """

    def compile_vectorizing(signature: Any) -> Any:
        usual, config.SLP_VECTORIZE = config.SLP_VECTORIZE, 1  # type: ignore[attr-defined]
        try:
            return compile_(signature)
        finally:
            config.SLP_VECTORIZE = usual  # type: ignore[attr-defined]

    return compile_vectorizing


def _alone(compile_: Callable[[Any], Any], cache: CompileCache) -> Callable[[Any], Any]:
    """Let a compiler run in one process at a time; it looks first whether the cache keeps what it is asked for."""

    def compile_alone(signature: Any) -> Any:
        global _depth
        with _own:
            _depth += 1
            try:
                if _depth > 1 or cache.cache_path is None:
                    return compile_(signature)
                with _locked(Path(cache.cache_path)), _uncollected():
                    return compile_(signature)
            finally:
                _depth -= 1

    return compile_alone


@contextmanager
def _uncollected() -> Iterator[None]:
    """Keep Python from looking for garbage, of which a compiler makes little among much else: a seventh of its time."""
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.enable()


@contextmanager
def _locked(folder: Path) -> Iterator[None]:
    """Keep other processes from compiling into a folder; where it can't be locked each is on its own."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        file = open(folder / _LOCK_FILE, 'wb', opener=_open_lock)  # noqa: SIM115  # closed below
    except OSError:
        yield
        return
    with file:
        with suppress(OSError):  # of a file system without locks
            _lock(file.fileno())
        yield


def _open_lock(path: str, _: int) -> int:
    """
    Open a file that is locked and not written; a link or a named pipe in its place is not followed or waited for.

    Nobody else may open it: who can read a file can lock it.
    """
    file = os.open(path, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_NONBLOCK, 0o600)
    with suppress(OSError):  # of another owner
        os.fchmod(file, 0o600)  # earlier versions made it for all to read
    return file


def _lock(file: int) -> None:
    """Wait for a lock, which ends with its file; say so, each second, where it takes long."""
    due = time.monotonic() + _PATIENCE
    while True:
        try:
            return fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            if time.monotonic() > due:
                due += _AGAIN
                for tell in _waiting:
                    tell()
            time.sleep(_PAUSE)


@contextmanager
def announced(tell: Callable[[str | None], None], wait: Callable[[], None]) -> Iterator[None]:
    """
    Tell, once, that functions are about to be compiled; not where machine code is there already.

    `tell` gets the folder in which it is kept, or None where it is lost with the process. `wait` is called each
    second in which another process compiles them.
    """
    _waiting.append(wait)
    try:
        with install_listener('numba:compile', _First(tell)):
            yield
    finally:
        _waiting.remove(wait)


class _First(Listener):
    def __init__(self, tell: Callable[[str | None], None]) -> None:
        self._tell: Callable[[str | None], None] | None = tell

    def on_start(self, event: Event) -> None:
        if self._tell is not None:
            tell, self._tell = self._tell, None
            tell(event.data['dispatcher'].stats.cache_path)

    def on_end(self, event: Event) -> None:
        """Nothing is told of it."""
