"""The one error that a user can mend."""


class InputError(Exception):
    """
    Something that the user gave cannot be used.

    The message is one line for the user: what is wrong, where, and what to do next. Programs print it without a
    traceback and end with exit code 2.
    """
