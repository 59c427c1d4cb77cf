"""Numba's compiler: machine code is kept on disk, or in memory where no folder can be written."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from typing import Any, cast

from numba import njit
from numba.core.event import Event, Listener, install_listener


def compiler(**options: Any) -> Callable[[Callable[..., Any]], Any]:
    """Return a decorator that compiles a function on its first call, with some options of Numba's."""

    def compiled(function: Callable[..., Any]) -> Any:
        try:
            return njit(cache=True, **options)(function)
        except RuntimeError:  # neither the installation nor the user's cache can be written
            return njit(**options)(function)

    return compiled


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
