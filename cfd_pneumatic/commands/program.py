# SPDX-License-Identifier: Apache-2.0
"""Common parts of the offline programs: parser, shared options, error messages and exit codes."""

from __future__ import annotations

import argparse
import io
import math
import os
import re
import sys
import warnings
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NoReturn, TextIO

from cfd_pneumatic import __version__
from cfd_pneumatic.convention import AMBIENT_PRESSURE, AMBIENT_PRESSURES
from cfd_pneumatic.errors import InputError, printable
from cfd_pneumatic.examples import example_of
from cfd_pneumatic.runtime import BAD_INPUT, INTERRUPTED
from cfd_pneumatic.units import UNITS

BROKEN_PIPE = 141

_LONGEST_LINE = 2_000  # characters of an error message
_LONGEST_SHOWN = 40  # characters of an argument in an error message
_LONGEST_MESSAGE = 400  # characters of a message of argparse, which may list all choices and the argument


_QUANTITY = re.compile(r'([-+]?[0-9.]+(?:[eE][-+]?[0-9]+)?)\s*([A-Za-z%/]*)')

_NEGATIVE_NUMBER = re.compile(r'-\.?[0-9].*')
"""A negative number with or without a unit; argparse itself recognises neither units nor exponents."""


class _Formatter(argparse.HelpFormatter):
    """A formatter that keeps the line breaks of an example."""

    def _fill_text(self, text: str, width: int, indent: str) -> str:
        return text if text.startswith('example:') else super()._fill_text(text, width, indent)


class _Parser(argparse.ArgumentParser):
    """A parser that reports a wrong argument as an `InputError`, and takes `-20N` for a number, not for an option."""

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self._negative_number_matcher = _NEGATIVE_NUMBER

    def error(self, message: str) -> NoReturn:
        shown = message if len(message) <= _LONGEST_MESSAGE else f'{message[:_LONGEST_MESSAGE]} ...'
        raise InputError(f'{shown}; see {self.prog} --help')


def parser_of(name: str, description: str) -> argparse.ArgumentParser:
    """Return a parser without arguments; its help ends with the example of the program."""
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
    """Return the value of an option as a finite number."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise argparse.ArgumentTypeError(f'{text[:_LONGEST_SHOWN]!r} is not a finite number')
    return value


def quantity(kind: str, per_second: bool = False) -> Callable[[str], float]:
    """
    Return the function that converts an option such as `0.05mm`, `100mm/s` or `3e5` to SI units.

    Parameters
    ----------
    kind
        Quantity in `units.UNITS`, such as `length`; a number without a unit is in SI units.
    per_second
        Whether the option is a rate of the quantity.

    """
    suffix = '/s' if per_second else ''
    units = {f'{name}{suffix}': unit.si for name, unit in UNITS.items() if unit.quantity == kind}

    def converted(text: str) -> float:
        match = _QUANTITY.fullmatch(text.strip())
        if match is None or (match[2] and match[2] not in units):
            raise argparse.ArgumentTypeError(
                f'{text[:_LONGEST_SHOWN]!r} is not a number, or not in one of the units {", ".join(units)}'
            )
        return number(match[1]) * (units[match[2]] if match[2] else 1.0)

    return converted


def ambient_pressure(text: str) -> float:
    """Return the value of an option as an absolute ambient pressure [Pa]."""
    value = number(text)
    lowest, highest = AMBIENT_PRESSURES
    if not lowest <= value <= highest:
        raise argparse.ArgumentTypeError(f'{value:g} Pa is outside {lowest:g} to {highest:g} Pa')
    return value


def add_mapping(parser: argparse.ArgumentParser) -> None:
    """Add the option for the mapping file, which is required for a table and optional for a bag."""
    text = 'YAML file that names the topics or columns; `csv_to_bag --help` shows an example'
    parser.add_argument('--mapping', metavar='FILE', type=Path, help=text)


def add_ambient_pressure(parser: argparse.ArgumentParser, meaning: str) -> None:
    """Add the option for the absolute ambient pressure [Pa]."""
    text = f'{meaning} [Pa] (default: %(default)s)'
    parser.add_argument('--ambient-pressure', type=ambient_pressure, default=AMBIENT_PRESSURE, metavar='PA', help=text)


def add_overwriting(parser: argparse.ArgumentParser) -> None:
    """Add the option that replaces files which this program did not write."""
    text = 'also replace files that this program did not write (default: replace only results of earlier runs)'
    parser.add_argument('--overwrite', action='store_true', help=text)


def add_overwriting_of_bags(parser: argparse.ArgumentParser) -> None:
    """Add the option that replaces an existing bag, and the former name of the option."""
    parser.add_argument('--overwrite', action='store_true', help='replace an existing bag')
    parser.add_argument('--force', dest='overwrite', action='store_true', help=argparse.SUPPRESS)


def run(name: str, program: Callable[[Sequence[str] | None], None], arguments: Sequence[str] | None = None) -> int:
    """
    Run a program and return its exit code.

    Parameters
    ----------
    name : str
        Name of the program, the first word of an error message.
    program : callable
        Function of the arguments that does the work.
    arguments : sequence of str, optional
        Arguments; by default those of the command line.

    Returns
    -------
    int
        0 after success; 2 after an `InputError`, whose line is printed to stderr; 130 after an interrupt; 141 if the
        reader of the output is closed.

    """
    # The programs have threads of their own. Threads of OpenBLAS would compete for the same cores and double the
    # time on a busy machine. OpenBLAS reads the variable when NumPy is imported; therefore programs import NumPy late.
    os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors='backslashreplace')  # the name of a file may be invalid UTF-8
    try:
        with warnings.catch_warnings():
            warnings.simplefilter('ignore', RuntimeWarning)  # overflows in NumPy lead to messages of this program
            program(arguments)
        sys.stdout.flush()
    except InputError as error:
        return _print_error(name, str(error))
    except KeyboardInterrupt:
        return INTERRUPTED
    except BrokenPipeError:
        os.dup2(
            os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno()
        )  # otherwise Python reports the broken pipe again at exit
        return BROKEN_PIPE
    except OSError as error:  # e.g. a full disk or a name that is too long
        if error.filename is None and not _is_writable(sys.stdout):
            return _print_error(name, f'cannot write to the standard output: {error.strerror or error}')
        prefix = f'{error.filename}: ' if error.filename else ''
        return _print_error(name, f'{prefix}{error.strerror or error}')
    return 0


def _is_writable(stream: TextIO) -> bool:
    """Return whether an empty line can be written; if not, drop the buffer, which Python would report at exit."""
    try:
        print(file=stream, flush=True)
    except OSError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())
        return False
    return True


def _print_error(name: str, reason: str) -> int:
    """Print an error message of limited length and return the exit code."""
    line = printable(reason)
    shown = line if len(line) <= _LONGEST_LINE else f'{line[: _LONGEST_LINE // 2]} ... {line[-_LONGEST_LINE // 2 :]}'
    print(f'{name}: error: {shown}', file=sys.stderr)
    return BAD_INPUT
