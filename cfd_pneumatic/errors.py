# SPDX-License-Identifier: Apache-2.0
"""The one error that a user can mend, how names from outside are printed, and how files are quoted."""

import re

_LONGEST_QUOTE = 40
_QUOTE = re.compile('“[^“”]*”')


class InputError(Exception):
    """
    Something that the user gave cannot be used.

    The message is one line for the user: what is wrong, where, and what to do next. Programs print it without a
    traceback and end with exit code 2.
    """


class DamageError(ValueError):
    """
    Data are not what was written, or declare what cannot be.

    The message says so in general: it quotes nothing of the data.
    """


def printable(text: str) -> str:
    """Return a text in one line, with nothing in it that a terminal would obey: names in files may hold anything."""
    line = ' '.join(text.split())
    return ''.join(one if one.isprintable() else repr(one)[1:-1] for one in line)


def quoted(text: str) -> str:
    """Return at most 40 characters of a file's content, marked as a quotation by “ and ”, in one line."""
    return f'“{printable(re.sub("[“”]", "?", text))[:_LONGEST_QUOTE]}”'


def without_quotations(message: str) -> str:
    """Return a message without what it quotes of files: others than the file's owner may read it."""
    return re.sub('(.*”|“.*)', '...', _QUOTE.sub('...', message))  # a message that was cut may hold half a quotation
