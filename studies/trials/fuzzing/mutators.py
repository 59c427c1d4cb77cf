# SPDX-License-Identifier: Apache-2.0
"""Change valid inputs at random, reproducibly for a generator."""

from __future__ import annotations

import math
import re
import struct
from collections.abc import Callable, Sequence
from random import Random

Mutator = Callable[[bytes, Random], bytes]

_NUMBER = re.compile(rb'(?<![\w.])[-+]?\d[\d_]*(\.\d*)?([eE][-+]?\d+)?')
_WORD = re.compile(rb'[A-Za-z_]\w*')

NUMBERS = (
    *(b'0', b'-0.0', b'1', b'-1', b'1e9', b'-1e9', b'1e300', b'1e-300', b'1e308', b'9e999', b'1e', b'1' * 400),
    *(
        b'.nan',
        b'nan',
        b'.inf',
        b'-inf',
        b'0x10',
        b'1_000',
        b'007',
        b'0x' + b'f' * 5000,
        b'1,5',
        b'true',
        b'null',
        b'~',
        b'',
        b"'1'",
    ),
    *(b'9223372036854775808', b'-9223372036854775809', b'4294967296', b'2001-01-01', b'\xd9\xa3'),
)
"""Replacements of a number."""

JSON_NUMBERS = (
    *(b'0', b'-0.0', b'1', b'-1', b'1e9', b'1e300', b'1e-300', b'1e308', b'1e400', b'1' * 400, b'NaN', b'Infinity'),
    *(b'-Infinity', b'true', b'null', b'"1"', b'"x"', b'[]', b'{}', b'[1e5]', b'9223372036854775808', b'1_0', b'01'),
)
"""Replacements of a number in JSON."""

SECRET = b'Zq7Xk9wVb2LmR4tY'
"""A word that no message may quote."""

TEXTS = (
    *(SECRET, SECRET),
    *(b'', b'x', b'x' * 3000, b'y', b'on', b'null', b'{}', b'[]', b'[x, y]', b'{a: b}', b'&a [*a]', b'*nobody'),
    *(b'!!python/name:os.system', b'!!binary aaa', b'\xff\xfe', b'\xef\xbb\xbf', b'\x00', b'\x1b[31m', b'\xe2\x80\xa8'),
    *(b'=1+1', b'../../etc', b'"', b"'", b'%s', b': ', b'- ', b'#', b'|', b'>', b'<<: *a', b'\n', b'\t', b'\r'),
)
"""Replacements of a word."""

INTEGERS = (0, 1, 2, 4, 255, 256, 2**16 - 1, 2**31 - 1, 2**31, 2**32 - 1, 2**40, 2**63 - 1, 2**63, 2**64 - 1)


DOUBLES = (math.nan, math.inf, -math.inf, 1e308, -1e308, 1e155, 1e13, 5e-324, -0.0, 0.0, 1e-3, -1.0, 3e4, 1e5)


def span(data: bytes, rng: Random, longest: int = 64) -> tuple[int, int]:
    """Return begin and end of a random piece."""
    begin = rng.randrange(len(data) + 1)
    return begin, min(len(data), begin + rng.randint(1, longest))


def flip(data: bytes, rng: Random) -> bytes:
    """Flip a bit."""
    if not data:
        return data
    changed = bytearray(data)
    changed[rng.randrange(len(data))] ^= 1 << rng.randrange(8)
    return bytes(changed)


def cut(data: bytes, rng: Random) -> bytes:
    """Remove the end."""
    return data[: rng.randrange(len(data) + 1)]


def drop(data: bytes, rng: Random) -> bytes:
    """Remove a piece."""
    begin, end = span(data, rng)
    return data[:begin] + data[end:]


def repeat(data: bytes, rng: Random) -> bytes:
    """Repeat a piece once, or many times."""
    begin, end = span(data, rng, 256)
    return data[:end] + data[begin:end] * rng.choice((1, 1, 1, 20)) + data[end:]


def blank(data: bytes, rng: Random) -> bytes:
    """Fill a piece with zeros."""
    begin, end = span(data, rng)
    return data[:begin] + bytes(end - begin) + data[end:]


def integer(data: bytes, rng: Random) -> bytes:
    """Write an extreme integer at a random place."""
    size = rng.choice((1, 2, 4, 8))
    begin = rng.randrange(max(1, len(data) - size))
    value = (rng.choice(INTEGERS) % 2 ** (8 * size)).to_bytes(size, rng.choice(('little', 'big')))
    return data[:begin] + value + data[begin + size :]


def double(data: bytes, rng: Random) -> bytes:
    """Write an extreme floating-point number at a random place."""
    begin = 4 * rng.randrange(max(1, len(data) // 4 - 1))
    return data[:begin] + struct.pack('<d', rng.choice(DOUBLES)) + data[begin + 8 :]


def _replaced(data: bytes, rng: Random, pattern: re.Pattern[bytes], values: Sequence[bytes]) -> bytes:
    matches = list(pattern.finditer(data))
    if not matches:
        return data
    match = rng.choice(matches)
    return data[: match.start()] + rng.choice(values) + data[match.end() :]


def number(data: bytes, rng: Random) -> bytes:
    """Replace a number."""
    return _replaced(data, rng, _NUMBER, NUMBERS)


def json_number(data: bytes, rng: Random) -> bytes:
    """Replace a number in JSON."""
    return _replaced(data, rng, _NUMBER, JSON_NUMBERS)


def word(data: bytes, rng: Random) -> bytes:
    """Replace a word."""
    return _replaced(data, rng, _WORD, TEXTS)


def word_of_text(data: bytes, rng: Random) -> bytes:
    """Replace a word by another word of the text."""
    return _replaced(data, rng, _WORD, _WORD.findall(data))


def line(data: bytes, rng: Random) -> bytes:
    """Remove, repeat, move or indent a line."""
    lines = data.splitlines(keepends=True) or [b'']
    index = rng.randrange(len(lines))
    removed = lines.pop(index)
    change = rng.randrange(4)
    if change == 1:
        lines[index:index] = [removed, removed]
    elif change == 2:
        lines.insert(rng.randrange(len(lines) + 1), removed)
    elif change == 3:
        lines.insert(index, b' ' * rng.randrange(6) + removed.lstrip())
    return b''.join(lines)


def insert(data: bytes, rng: Random) -> bytes:
    """Insert a text at a random place."""
    begin = rng.randrange(len(data) + 1)
    return data[:begin] + rng.choice(TEXTS) + data[begin:]


BINARY: tuple[Mutator, ...] = (flip, flip, flip, double, double, integer, integer, integer, cut, drop, repeat, blank)
WORDS: tuple[Mutator, ...] = (
    word_of_text,
    word_of_text,
    word_of_text,
    word_of_text,
    line,
    line,
    line,
    number,
    word,
    insert,
    flip,
    cut,
)
TEXT: tuple[Mutator, ...] = (*(number, number, number, word), *WORDS, drop, repeat)
DEFINITION: tuple[Mutator, ...] = (*[word_of_text] * 5, *WORDS)
JSON: tuple[Mutator, ...] = (*[json_number] * 8, *[word_of_text] * 3, *TEXT)


def mutated(data: bytes, rng: Random, mutators: Sequence[Mutator]) -> bytes:
    """Return an input with 1 to 4 changes."""
    for _ in range(rng.choice((1, 1, 1, 1, 2, 4))):
        data = rng.choice(mutators)(data, rng)
    return data
