# SPDX-License-Identifier: Apache-2.0
"""Many inputs of a kind: each is given to what reads it, what becomes of it is counted, what is new is kept."""

from __future__ import annotations

import re
import signal
import sys
import time
import traceback
from abc import ABC, abstractmethod
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from random import Random
from types import FrameType
from typing import Any
from warnings import catch_warnings, simplefilter

from cfd_pneumatic.errors import InputError

PATIENCE = 10.0
"""No input may take longer [s]."""

_PACKAGE = str(Path(sys.modules['cfd_pneumatic'].__file__ or '').parent)
_FRESH = 0.05  # share of the inputs that are whole
_PARENTS = 40  # whole inputs from which the changed ones start
_LARGEST = 2**18  # a parent has no more [bytes]


class Fault(Exception):  # noqa: N818, it is none of a program's errors
    """Something that must not become of any input."""


class TooLong(BaseException):
    """An input took too long; no reader may take this for damage."""


@dataclass(frozen=True)
class Input:
    """
    An input.

    Attributes
    ----------
    files
        Names and contents.
    about
        What is known of the valid one that it comes from.
    whole
        Whether it is valid as it is.

    """

    files: dict[str, bytes]
    about: Any = None
    whole: bool = True

    def changed(self, name: str, content: bytes) -> Input:
        """Return it with another content of one file."""
        return Input({**self.files, name: content}, self.about, whole=False)

    def save(self, folder: Path) -> None:
        """Write the files."""
        for name, content in self.files.items():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            (folder / name).write_bytes(content)


class Kind(ABC):
    """
    A kind of inputs.

    Attributes
    ----------
    name
        In words.

    """

    name: str

    def start(self, folder: Path) -> None:  # noqa: B027
        """Make what all inputs need; the folder is for them."""

    @abstractmethod
    def valid(self, rng: Random) -> Input:
        """Return a valid input."""

    @abstractmethod
    def changed(self, parent: Input, rng: Random) -> Input:
        """Return an input with changes."""

    @abstractmethod
    def give(self, one: Input) -> str:
        """
        Let an input be read; return what was said about it, if anything.

        Raises
        ------
        InputError
            If it is refused.
        Fault
            If what came of it is wrong.

        """

    @abstractmethod
    def parses(self, one: Input) -> bool:
        """Return whether an input that was refused gets past the first parser of its format."""

    def stop(self) -> None:  # noqa: B027
        """End what `start` began; raise `Fault` where it is not as it should be."""


@dataclass
class Tally:
    """
    What became of many inputs.

    Attributes
    ----------
    kind
        Of the inputs.
    inputs, whole, read, early
        How many were tried, were valid, were read, were refused by the first parser.
    slowest
        Longest time that one took [s].
    seconds
        Time of the processor for all of them [s].
    peak
        Most memory of the process [bytes].
    parents
        Inputs that were kept.
    faults
        What must not be, by where it happened: how often, the first input's number, and what it was.

    """

    kind: str
    inputs: int = 0
    whole: int = 0
    read: int = 0
    early: int = 0
    slowest: float = 0.0
    seconds: float = 0.0
    peak: int = 0
    parents: int = 0
    faults: dict[str, tuple[int, int, str]] = field(default_factory=dict)

    def note(self, where: str, number: int, what: str) -> bool:
        """Count a fault; return whether it is the first one there."""
        count, first, said = self.faults.get(where, (0, number, what))
        self.faults[where] = (count + 1, first, said)
        return count == 0


def run(kind: Kind, count: int, seed: int, folder: Path, kept: Path | None = None) -> Tally:
    """
    Give many inputs of a kind.

    Parameters
    ----------
    kind, count
        What, and how many.
    seed
        The same makes the same inputs.
    folder
        Where they are written to; it may be in memory.
    kept
        Where those are left that lead to faults.

    """
    tally, began = Tally(kind.name), time.process_time()
    kind.start(folder)
    try:
        _give_all(kind, count, seed, tally, kept)
    finally:
        try:
            kind.stop()
        except Fault as fault:
            tally.note('at the end', count, str(fault))
    tally.seconds, tally.peak = time.process_time() - began, _peak()
    return tally


def _give_all(kind: Kind, count: int, seed: int, tally: Tally, kept: Path | None) -> None:
    parents = [kind.valid(Random(f'{seed} {kind.name} {number}')) for number in range(_PARENTS)]
    seen: set[str] = set()
    for number in range(count):
        rng = Random(f'{seed} {kind.name} input {number}')
        if rng.random() < _FRESH:
            one = kind.valid(rng)
        else:
            some = parents if rng.random() < 0.5 else parents[:_PARENTS]
            one = kind.changed(rng.choice(some), rng)
        began = time.perf_counter()
        where = _outcome(kind, one, number, tally, kept)
        tally.slowest = max(tally.slowest, time.perf_counter() - began)
        tally.inputs += 1
        tally.whole += one.whole
        if where not in seen:
            seen.add(where)
            if not one.whole and sum(map(len, one.files.values())) < _LARGEST:
                parents.append(one)
                tally.parents += 1


def _outcome(kind: Kind, one: Input, number: int, tally: Tally, kept: Path | None) -> str:
    """Let an input be read, count what comes of it, and return where in the code that was decided."""
    try:
        with limited(PATIENCE), catch_warnings():
            simplefilter('error', RuntimeWarning)  # which a user would see
            said = kind.give(one)
    except InputError as refusal:
        where = _places(refusal) or re.sub(r'[\d.]+', '#', str(refusal))
        tally.early += not kind.parses(one)
        if not one.whole:
            return where
        error: BaseException = refusal
        what = f'a valid input is refused: {refusal}'
    except (Exception, TooLong) as unexpected:
        error, where = unexpected, f'{type(unexpected).__name__} {_places(unexpected)}'
        what = ''.join(traceback.format_exception(error))
        if isinstance(error, Fault):
            what, where = str(error), re.sub(r'[\d.]+', '#', str(error))
    else:
        tally.read += 1
        return f'read {re.sub(r"[0-9.]+", "#", said)}'
    if tally.note(where, number, what) and kept is not None:
        one.save(kept / kind.name.replace(' ', '_') / str(number))
    return where


def _places(error: BaseException | None) -> str:
    """Return the lines of the package through which an error went, and the one that it comes from."""
    places = []
    while error is not None:
        places += [
            f'{frame.f_code.co_filename.removeprefix(_PACKAGE)}:{line}'
            for frame, line in traceback.walk_tb(error.__traceback__)
            if frame.f_code.co_filename.startswith(_PACKAGE)
        ]
        error = error.__cause__
    return ' '.join(places)


@contextmanager
def limited(seconds: float) -> Iterator[None]:
    """Raise `TooLong` in what takes longer; it must not be nested."""

    def end(_number: int, _frame: FrameType | None) -> None:
        raise TooLong

    before = signal.signal(signal.SIGALRM, end)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)


def _peak() -> int:
    """Return the most memory that this process has had [bytes]."""
    with suppress(OSError):
        for line in Path('/proc/self/status').read_text(encoding='utf-8').splitlines():
            if line.startswith('VmHWM'):
                return int(line.split()[1]) * 1024
    return 0
