# SPDX-License-Identifier: Apache-2.0
"""Give many inputs of a kind to their reader, count the outcomes, and keep inputs that reach new code."""

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
"""Time limit of an input [s]."""

_PACKAGE = str(Path(sys.modules['cfd_pneumatic'].__file__ or '').parent)
_FRESH = 0.05  # share of valid inputs
_PARENTS = 40  # valid inputs from which the changed inputs start
_LARGEST = 2**18  # size of a parent [bytes]


class Fault(Exception):  # noqa: N818, not an error of a program
    """An outcome that no input may have."""


class TooLong(BaseException):
    """An input took too long; a BaseException, so that no reader catches the signal."""


@dataclass(frozen=True)
class Input:
    """
    An input of a reader.

    Attributes
    ----------
    files
        Contents of the files by name.
    about
        Facts about the valid input from which this input comes.
    whole
        Whether the input is valid.

    """

    files: dict[str, bytes]
    about: Any = None
    whole: bool = True

    def changed(self, name: str, content: bytes) -> Input:
        """Return the input with a new content of a file."""
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
        Name for people.

    """

    name: str

    def start(self, folder: Path) -> None:  # noqa: B027
        """Prepare the reader; inputs are written to the folder."""

    @abstractmethod
    def valid(self, rng: Random) -> Input:
        """Return a valid input."""

    @abstractmethod
    def changed(self, parent: Input, rng: Random) -> Input:
        """Return an input with changes."""

    @abstractmethod
    def give(self, case: Input) -> str:
        """
        Give an input to the reader; return the reader's notes.

        Raises
        ------
        InputError
            If the reader refuses the input.
        Fault
            If the outcome is wrong.

        """

    @abstractmethod
    def parses(self, case: Input) -> bool:
        """Return whether the first parser of the format accepts a refused input."""

    def stop(self) -> None:  # noqa: B027
        """End the reader; raise `Fault` if the reader is in a wrong state."""


@dataclass
class Tally:
    """
    Outcomes of many inputs.

    Attributes
    ----------
    kind
        Name of the kind of inputs.
    inputs, whole, read, early
        Numbers of inputs: tried, valid, read, refused by the first parser.
    slowest
        Longest time of an input [s].
    seconds
        Processor time of all inputs [s].
    peak
        Peak memory of the process [bytes].
    parents
        Number of kept inputs.
    faults
        Faults by place in the code: count, number of the first input, description.

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

    def note(self, place: str, number: int, description: str) -> bool:
        """Count a fault; return whether the fault is the first at its place."""
        count, first, text = self.faults.get(place, (0, number, description))
        self.faults[place] = (count + 1, first, text)
        return count == 0


def run(kind: Kind, count: int, seed: int, folder: Path, kept: Path | None = None) -> Tally:
    """
    Give many inputs of a kind to their reader; return the outcomes.

    Parameters
    ----------
    kind, count
        Kind and number of inputs.
    seed
        Seed of the random inputs.
    folder
        Folder of the inputs; may be in memory.
    kept
        Folder for inputs that lead to faults; None: inputs are not kept.

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
    places: set[str] = set()
    for number in range(count):
        rng = Random(f'{seed} {kind.name} input {number}')
        if rng.random() < _FRESH:
            case = kind.valid(rng)
        else:
            candidates = parents if rng.random() < 0.5 else parents[:_PARENTS]
            case = kind.changed(rng.choice(candidates), rng)
        began = time.perf_counter()
        place = _outcome(kind, case, number, tally, kept)
        tally.slowest = max(tally.slowest, time.perf_counter() - began)
        tally.inputs += 1
        tally.whole += case.whole
        if place not in places:
            places.add(place)
            if not case.whole and sum(map(len, case.files.values())) < _LARGEST:
                parents.append(case)
                tally.parents += 1


def _outcome(kind: Kind, case: Input, number: int, tally: Tally, kept: Path | None) -> str:
    """Give an input to the reader, count the outcome, and return the outcome's place in the code."""
    try:
        with limited(PATIENCE), catch_warnings():
            simplefilter('error', RuntimeWarning)  # a user would see them
            notes = kind.give(case)
    except InputError as refusal:
        place = _places(refusal) or re.sub(r'[\d.]+', '#', str(refusal))
        tally.early += not kind.parses(case)
        if not case.whole:
            return place
        error: BaseException = refusal
        description = f'a valid input is refused: {refusal}'
    except (Exception, TooLong) as unexpected:
        error, place = unexpected, f'{type(unexpected).__name__} {_places(unexpected)}'
        description = ''.join(traceback.format_exception(error))
        if isinstance(error, Fault):
            description, place = str(error), re.sub(r'[\d.]+', '#', str(error))
    else:
        tally.read += 1
        return f'read {re.sub(r"[0-9.]+", "#", notes)}'
    if tally.note(place, number, description) and kept is not None:
        case.save(kept / kind.name.replace(' ', '_') / str(number))
    return place


def _places(error: BaseException | None) -> str:
    """Return the lines of the package in the tracebacks of an error and its causes."""
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
    """Raise `TooLong` in a body that takes longer; must not be nested."""

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
    """Return the peak memory of this process [bytes]."""
    with suppress(OSError):
        for line in Path('/proc/self/status').read_text(encoding='utf-8').splitlines():
            if line.startswith('VmHWM'):
                return int(line.split()[1]) * 1024
    return 0
