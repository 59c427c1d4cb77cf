# SPDX-License-Identifier: Apache-2.0
"""What every node's main does: say what it is, start, spin, end cleanly, say in one line what is wrong."""

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

_SPIN_FOR = 0.2  # EventsExecutor's own spin() does not return on a signal; spin_once with a limit does [s]
_SHUTDOWN = 1.0  # how long callbacks may take to end [s]
_ENDING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)

_HINTS = {
    'Sequence should be of same type': 'write 1.0 for 1',
    "type 'INTEGER', expecting type 'DOUBLE'": 'write 1.0 for 1',
    "type 'INTEGER_ARRAY', expecting type 'DOUBLE_ARRAY'": 'write 1.0 for 1',
    "type 'BOOL', expecting type 'STRING'": 'quote it, as YAML takes a bare y or on for true',
}
"""What to do about some of ROS 2's own messages."""

_MISTAKES = (
    InputError,
    InvalidParameterTypeException,
    InvalidParameterValueException,
    NameValidationException,
    ParameterUninitializedException,
)


def run(name: str, make_node: Callable[[], Node], args: Sequence[str] | None = None) -> int:
    """
    Run a node until it is interrupted or ROS shuts down; return the program's exit code.

    A mistake in the parameters or files that the user gave is one line on standard error and exit code 2. With `--help`
    it says what the node is, with `--version` which one, and starts nothing.
    """
    if print_help_or_version(name, sys.argv[1:] if args is None else args):
        return 0
    ending = _Ending()
    try:
        check_arguments(name, sys.argv[1:] if args is None else args)
        patch_rclpy()
        _start(args)
        logging.getLogger('cfd_pneumatic').addHandler(_RosLog(name))
        node = _made(make_node)
        warn_of_undeclared(node)
        ending.made.set()
        try:
            _spin(node, ending)
        finally:
            node.destroy_node()
    except ExternalShutdownException:
        pass
    except _MISTAKES as error:
        print(f'{name}: error: {_one_line(str(error))}', file=sys.stderr)
        return BAD_INPUT
    finally:
        rclpy.try_shutdown()
        ending.over()
    return 0


class _RosLog(logging.Handler):
    """Has ROS log what the package warns of, such as a compile cache that is not used."""

    def __init__(self, name: str) -> None:
        super().__init__(logging.WARNING)
        self._logger = get_logger(name)

    def emit(self, record: logging.LogRecord) -> None:
        self._logger.warning(record.getMessage())


def _made(make_node: Callable[[], Node]) -> Node:
    """Return the node; what ROS has against it is the user's to mend, as a missing enclave."""
    try:
        with catch_warnings():
            simplefilter('ignore')  # rcl has another complaint about a node that it could not make
            return make_node()
    except RuntimeError as error:
        if type(error).__name__ != 'RCLError':  # which rclpy does not export
            raise
        raise InputError(f'ROS cannot make the node: {error}') from error


class _Ending:
    """
    What SIGINT, SIGTERM, and SIGHUP of a terminal that is closed, do at any moment.

    Until the node is made they end the program at once, which has nothing to finish yet: an exception would be raised
    in whatever library is at work. Then they ask the spinning to end, and nothing stops what has to be finished, such
    as a bag. rclpy's own handlers would take the context away from callbacks that are running.
    """

    def __init__(self) -> None:
        self.asked = False
        self.made = Event()
        for number in _ENDING:
            if number != signal.SIGHUP or signal.getsignal(number) != signal.SIG_IGN:  # as nohup has it
                signal.signal(number, self._ask)
        heard, print_help_or_version = os.pipe()
        os.set_blocking(print_help_or_version, False)
        signal.set_wakeup_fd(print_help_or_version, warn_on_full_buffer=False)
        Thread(target=self._listen, args=(heard,), daemon=True).start()

    def _ask(self, *_: object) -> None:
        self.asked = True
        if not self.made.is_set():
            os._exit(0)

    def over(self) -> None:
        """Be deaf from now on: Python itself, as it ends, would let another signal end it with its own exit code."""
        for number in _ENDING:
            signal.signal(number, signal.SIG_IGN)

    def _listen(self, heard: int) -> None:
        """Do so where the main thread is in machine code, as the compiler's, and does not hear a signal."""
        os.read(heard, 1)
        self._ask()


def _start(args: Sequence[str] | None) -> None:
    """Initialise ROS; a parameter file that it cannot read is the user's to mend."""
    if not any(map(os.environ.get, ('HOME', 'ROS_HOME', 'ROS_LOG_DIR'))):  # rcutils would say more, and less clearly
        raise InputError('ROS cannot start: it writes its log below HOME, which is not set: set it, or ROS_LOG_DIR')
    set_logger_level('rcl', LoggingSeverity.FATAL)  # it would say the same in a line of its own
    try:
        options = SignalHandlerOptions.NO
        rclpy.init(args=None if args is None else list(args), signal_handler_options=options)
    except RuntimeError as error:
        raise InputError(f'ROS cannot start: {error}') from error
    if get_logger_level('rcl') == LoggingSeverity.FATAL:
        set_logger_level('rcl', LoggingSeverity.UNSET)


def _one_line(message: str) -> str:
    """Return a message in one line, without where in rcl's sources it comes from, and with what to do about it."""
    line = ' '.join(re.sub(r', at \S+:\d+', '', message).split())
    hint = next((hint for fragment, hint in _HINTS.items() if fragment in line), None)
    return line if hint is None else f'{line} ({hint})'


def _spin(node: Node, ending: _Ending) -> None:
    executor = _make_executor()
    try:
        executor.add_node(node)
        while rclpy.ok() and not ending.asked:
            executor.spin_once(timeout_sec=_SPIN_FOR)
    finally:
        executor.shutdown(timeout_sec=_SHUTDOWN)


def _make_executor() -> Executor:
    """
    Return the executor that hands messages over in the order in which they came.

    A set-point sent just before its sample must act on it; SingleThreadedExecutor hands them over by topic instead.
    """
    return SingleThreadedExecutor() if EventsExecutor is None else EventsExecutor()
