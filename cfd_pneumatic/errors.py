# SPDX-License-Identifier: Apache-2.0
"""Errors of input and damaged data, printable names, and quotations of files."""

import re

_LONGEST_QUOTE = 40
_QUOTE = re.compile('“[^“”]*”')


class InputError(Exception):
    """
    Input of the user cannot be used.

    The message is a line for the user: what is wrong, where, and what to do next. Programs print the message without a
    traceback and end with exit code 2.
    """


class DamageError(ValueError):
    """
    Data are damaged or declare impossible values.

    The message is general and quotes no data.
    """


def printable(text: str) -> str:
    """Return a text in a line without control characters; names in files may contain any characters."""
    line = ' '.join(text.split())
    return ''.join(character if character.isprintable() else repr(character)[1:-1] for character in line)


def quoted(text: str) -> str:
    """Return at most 40 characters of a file's content in “ and ”, in a line."""
    return f'“{printable(re.sub("[“”]", "?", text))[:_LONGEST_QUOTE]}”'


def without_quotations(message: str) -> str:
    """Return a message without quotations of files, for readers other than the file's owner."""
    return re.sub('(.*”|“.*)', '...', _QUOTE.sub('...', message))  # a truncated message may contain half a quotation
