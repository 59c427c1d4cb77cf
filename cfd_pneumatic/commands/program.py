# SPDX-License-Identifier: Apache-2.0
"""What all offline programs have in common: their help, and how they end."""

from __future__ import annotations

import argparse
import io
import math
import os
import sys
import warnings
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NoReturn, TextIO

from cfd_pneumatic import __version__
from cfd_pneumatic.convention import AMBIENT_PRESSURE, AMBIENT_PRESSURES
from cfd_pneumatic.errors import InputError, printable
from cfd_pneumatic.examples import example_of
from cfd_pneumatic.runtime import BAD_INPUT, INTERRUPTED

BROKEN_PIPE = 141

_LONGEST_LINE = 2_000
_LONGEST_SHOWN = 40  # characters of an argument
_LONGEST_MESSAGE = 400  # of argparse, which may list all choices, and repeats the argument


class _Formatter(argparse.HelpFormatter):
    """Leaves the lines of an example as they are."""

    def _fill_text(self, text: str, width: int, indent: str) -> str:
        return text if text.startswith('example:') else super()._fill_text(text, width, indent)


class _Parser(argparse.ArgumentParser):
    """Reports a wrong argument as all other bad input is reported: in one line."""

    def error(self, message: str) -> NoReturn:
        shown = message if len(message) <= _LONGEST_MESSAGE else f'{message[:_LONGEST_MESSAGE]} ...'
        raise InputError(f'{shown}; see {self.prog} --help')


def parser_of(name: str, description: str) -> argparse.ArgumentParser:
    """Return a program's parser, without arguments yet, whose help ends with the program's example."""
    parser = _Parser(
        prog=name,
        description=description,
        epilog=example_of(name),
        formatter_class=_Formatter,
        allow_abbrev=False,  # an option that is added later must not change what a script means
    )
    parser.add_argument('--version', action='version', version=f'{name} {__version__}')
    return parser


def number(text: str) -> float:
    """Return the finite number that an option is given."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise argparse.ArgumentTypeError(f'{text[:_LONGEST_SHOWN]!r} is not a finite number')
    return value


def ambient_pressure(text: str) -> float:
    """Return the absolute pressure of the surroundings that an option is given [Pa]."""
    value = number(text)
    lowest, highest = AMBIENT_PRESSURES
    if not lowest <= value <= highest:
        raise argparse.ArgumentTypeError(f'{value:g} Pa is outside {lowest:g} to {highest:g} Pa')
    return value


def add_mapping(parser: argparse.ArgumentParser) -> None:
    """Add the option that names a mapping file, which a table needs and a bag may have."""
    text = 'YAML file that says what the topics or columns are; `csv_to_bag --help` shows one'
    parser.add_argument('--mapping', metavar='FILE', type=Path, help=text)


def add_ambient_pressure(parser: argparse.ArgumentParser, meaning: str) -> None:
    """Add the option that names the absolute pressure of the surroundings [Pa]."""
    text = f'{meaning} [Pa] (default: %(default)s)'
    parser.add_argument('--ambient-pressure', type=ambient_pressure, default=AMBIENT_PRESSURE, metavar='PA', help=text)


def add_overwriting(parser: argparse.ArgumentParser) -> None:
    """Add the option by which files are replaced that are not results of ours."""
    text = 'replace files that this program did not write, too (default: only results of earlier runs)'
    parser.add_argument('--overwrite', action='store_true', help=text)


def add_overwriting_of_bags(parser: argparse.ArgumentParser) -> None:
    """Add the option by which a bag is replaced, and its former name."""
    parser.add_argument('--overwrite', action='store_true', help='replace a bag that is there')
    parser.add_argument('--force', dest='overwrite', action='store_true', help=argparse.SUPPRESS)


def run(name: str, program: Callable[[Sequence[str] | None], None], arguments: Sequence[str] | None = None) -> int:
    """
    Run a program and return its exit code.

    Parameters
    ----------
    name : str
        Name of the program, which begins its error message.
    program : callable
        Takes the arguments, does the work.
    arguments : sequence of str, optional
        Arguments; by default those of the command line.

    Returns
    -------
    int
        0; 2 after an `InputError`, with its one line on stderr; as a shell reports it after an interrupt (130) or where
        the reader of the output has gone (141).

    """
    # The programs' threads are their own: those of NumPy's library beside them would only compete for the same cores,
    # which doubles the time on a busy machine. It asks once, when NumPy is loaded, and so programs import that late.
    os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors='backslashreplace')  # a file's name may be no text
    try:
        with warnings.catch_warnings():
            warnings.simplefilter('ignore', RuntimeWarning)  # NumPy's of overflow: what comes of it is said
            program(arguments)
        sys.stdout.flush()
    except InputError as error:
        return _refused(name, str(error))
    except KeyboardInterrupt:
        return INTERRUPTED
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # or Python complains again when it flushes
        return BROKEN_PIPE
    except OSError as error:  # the disk is full, a name is too long
        if error.filename is None and not _is_writable(sys.stdout):
            return _refused(name, f'cannot write to the standard output: {error.strerror or error}')
        where = f'{error.filename}: ' if error.filename else ''
        return _refused(name, f'{where}{error.strerror or error}')
    return 0


def _is_writable(stream: TextIO) -> bool:
    """Try to write an empty line. If that fails, drop what the stream holds: Python would complain of it at the end."""
    try:
        print(file=stream, flush=True)
    except OSError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())
        return False
    return True


def _refused(name: str, reason: str) -> int:
    """Say why in a line, as long as one can read."""
    line = printable(reason)
    shown = line if len(line) <= _LONGEST_LINE else f'{line[: _LONGEST_LINE // 2]} ... {line[-_LONGEST_LINE // 2 :]}'
    print(f'{name}: error: {shown}', file=sys.stderr)
    return BAD_INPUT
