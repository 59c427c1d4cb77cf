"""Numba's compiler: machine code is kept on disk, or in memory where no folder can be written."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from typing import Any, cast

from numba import config, njit
from numba.core.event import Event, Listener, install_listener


def compiler(**options: Any) -> Callable[[Callable[..., Any]], Any]:
    """Return a decorator that compiles a function on its first call, with some options of Numba's."""

    def compiled(function: Callable[..., Any]) -> Any:
        try:
            dispatcher = njit(cache=True, **options)(function)
        except RuntimeError:  # neither the installation nor the user's cache can be written
            dispatcher = njit(**options)(function)
        dispatcher.compile = _vectorizing(dispatcher.compile)
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


def announced(tell: Callable[[str | None], None]) -> AbstractContextManager[None]:
    """
    Tell, once, that functions are about to be compiled; not where machine code is there already.

    `tell` gets the folder in which it is kept, or None where it is lost with the process.
    """
    return cast(AbstractContextManager[None], install_listener('numba:compile', _First(tell)))


class _First(Listener):
    def __init__(self, tell: Callable[[str | None], None]) -> None:
        self._tell: Callable[[str | None], None] | None = tell

    def on_start(self, event: Event) -> None:
        if self._tell is not None:
            tell, self._tell = self._tell, None
            tell(event.data['dispatcher'].stats.cache_path)

    def on_end(self, event: Event) -> None:
        """Nothing is told of it."""
