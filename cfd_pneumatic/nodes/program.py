# SPDX-License-Identifier: Apache-2.0
"""Main function of every node: help, start, spin, clean end, errors in a single line."""

from __future__ import annotations

import logging
import os
import re
import signal
import sys
from collections.abc import Callable, Sequence
from threading import Event, Thread
from warnings import catch_warnings, simplefilter

import rclpy
from rclpy.exceptions import (
    InvalidParameterTypeException,
    InvalidParameterValueException,
    NameValidationException,
    ParameterUninitializedException,
)
from rclpy.executors import Executor, ExternalShutdownException, SingleThreadedExecutor
from rclpy.logging import LoggingSeverity, get_logger, get_logger_level, set_logger_level
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from cfd_pneumatic.errors import InputError
from cfd_pneumatic.nodes.parameter_files import check_arguments
from cfd_pneumatic.nodes.parameters import warn_of_undeclared
from cfd_pneumatic.nodes.rclpy_patches import patch_rclpy
from cfd_pneumatic.runtime import BAD_INPUT, print_help_or_version

try:
    from rclpy.experimental import EventsExecutor
except ImportError:  # before Jazzy
    EventsExecutor = None  # type: ignore[assignment]

_SPIN_FOR = 0.2  # EventsExecutor.spin() does not return on a signal; spin_once() with a limit does [s]
_SHUTDOWN = 1.0  # longest time for callbacks to end [s]
_END_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)

_HINTS = {
    'Sequence should be of same type': 'write 1.0 for 1',
    "type 'INTEGER', expecting type 'DOUBLE'": 'write 1.0 for 1',
    "type 'INTEGER_ARRAY', expecting type 'DOUBLE_ARRAY'": 'write 1.0 for 1',
    "type 'BOOL', expecting type 'STRING'": 'quote it, as YAML takes a bare y or on for true',
}
"""What to do about some of ROS 2's own messages."""

_USER_ERRORS = (
    InputError,
    InvalidParameterTypeException,
    InvalidParameterValueException,
    NameValidationException,
    ParameterUninitializedException,
)


def run(name: str, make_node: Callable[[], Node], args: Sequence[str] | None = None) -> int:
    """
    Run a node until it is interrupted or ROS shuts down; return the program's exit code.

    An invalid parameter or file is reported in a single line on standard error, with exit code 2. The options `--help`
    and `--version` print a text and start nothing.
    """
    if print_help_or_version(name, sys.argv[1:] if args is None else args):
        return 0
    shutdown = _Shutdown()
    try:
        check_arguments(name, sys.argv[1:] if args is None else args)
        patch_rclpy()
        _initialise(args)
        logging.getLogger('cfd_pneumatic').addHandler(_RosLog(name))
        node = _make_node(make_node)
        warn_of_undeclared(node)
        shutdown.node_made.set()
        try:
            _spin(node, shutdown)
        finally:
            node.destroy_node()
    except ExternalShutdownException:
        pass
    except _USER_ERRORS as error:
        print(f'{name}: error: {_format_error(str(error))}', file=sys.stderr)
        return BAD_INPUT
    finally:
        rclpy.try_shutdown()
        shutdown.ignore_signals()
    return 0


class _RosLog(logging.Handler):
    """Logs the package's warnings in ROS, such as an unused compile cache."""

    def __init__(self, name: str) -> None:
        super().__init__(logging.WARNING)
        self._logger = get_logger(name)

    def emit(self, record: logging.LogRecord) -> None:
        self._logger.warning(record.getMessage())


def _make_node(make_node: Callable[[], Node]) -> Node:
    """Make the node; ROS's errors, as a missing enclave, become errors for the user."""
    try:
        with catch_warnings():
            simplefilter('ignore')  # rcl also warns about a node that it could not make
            return make_node()
    except RuntimeError as error:
        if type(error).__name__ != 'RCLError':  # rclpy does not export the class
            raise
        raise InputError(f'ROS cannot make the node: {error}') from error


class _Shutdown:
    """
    Handles SIGINT, SIGTERM, and SIGHUP of a closed terminal.

    Before the node is made a signal ends the program at once: there is nothing to finish, and an exception could be
    raised in any library. Later a signal requests the end of spinning, and unfinished work, such as a bag, is
    completed. rclpy's handlers would shut down the context while callbacks run.
    """

    def __init__(self) -> None:
        self.is_requested = False
        self.node_made = Event()
        for number in _END_SIGNALS:
            if number != signal.SIGHUP or signal.getsignal(number) != signal.SIG_IGN:  # nohup ignores SIGHUP
                signal.signal(number, self._request)
        read_end, write_end = os.pipe()
        os.set_blocking(write_end, False)
        signal.set_wakeup_fd(write_end, warn_on_full_buffer=False)
        Thread(target=self._listen, args=(read_end,), daemon=True).start()

    def _request(self, *_: object) -> None:
        self.is_requested = True
        if not self.node_made.is_set():
            os._exit(0)

    def ignore_signals(self) -> None:
        """Ignore further signals, which would change the exit code while Python ends."""
        for number in _END_SIGNALS:
            signal.signal(number, signal.SIG_IGN)

    def _listen(self, read_end: int) -> None:
        """Handle a signal while the main thread runs machine code, as the compiler's, and runs no handler."""
        os.read(read_end, 1)
        self._request()


def _initialise(args: Sequence[str] | None) -> None:
    """Initialise ROS; ROS's errors, as an unreadable parameter file, become errors for the user."""
    # The message of rcutils is longer and less clear.
    if not any(map(os.environ.get, ('HOME', 'ROS_HOME', 'ROS_LOG_DIR'))):
        raise InputError('ROS cannot start: the log folder is below HOME, and HOME is not set. Set HOME or ROS_LOG_DIR')
    set_logger_level('rcl', LoggingSeverity.FATAL)  # rcl would log the same error in a second line
    try:
        options = SignalHandlerOptions.NO
        rclpy.init(args=None if args is None else list(args), signal_handler_options=options)
    except RuntimeError as error:
        raise InputError(f'ROS cannot start: {error}') from error
    if get_logger_level('rcl') == LoggingSeverity.FATAL:
        set_logger_level('rcl', LoggingSeverity.UNSET)


def _format_error(message: str) -> str:
    """Format a message in a single line, without places in rcl's sources, and with a hint."""
    line = ' '.join(re.sub(r', at \S+:\d+', '', message).split())
    hint = next((hint for fragment, hint in _HINTS.items() if fragment in line), None)
    return line if hint is None else f'{line} ({hint})'


def _spin(node: Node, shutdown: _Shutdown) -> None:
    executor = _make_executor()
    try:
        executor.add_node(node)
        while rclpy.ok() and not shutdown.is_requested:
            executor.spin_once(timeout_sec=_SPIN_FOR)
    finally:
        executor.shutdown(timeout_sec=_SHUTDOWN)


def _make_executor() -> Executor:
    """
    Return the executor that delivers messages in the order of arrival.

    A set-point sent just before a sample must act on the sample. SingleThreadedExecutor delivers messages by topic.
    """
    return SingleThreadedExecutor() if EventsExecutor is None else EventsExecutor()
