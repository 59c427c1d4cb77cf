# SPDX-License-Identifier: Apache-2.0
"""The one error that a user can mend, and how names from outside are printed."""


class InputError(Exception):
    """
    Something that the user gave cannot be used.

    The message is one line for the user: what is wrong, where, and what to do next. Programs print it without a
    traceback and end with exit code 2.
    """


def printable(text: str) -> str:
    """Return a text in one line, with nothing in it that a terminal would obey: names in files may hold anything."""
    line = ' '.join(text.split())
    return ''.join(one if one.isprintable() else repr(one)[1:-1] for one in line)
