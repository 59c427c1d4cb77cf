"""What every node's main does: start, spin, end cleanly, say in one line what is wrong."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from contextlib import suppress

import rclpy
from rclpy.exceptions import (
    InvalidParameterTypeException,
    InvalidParameterValueException,
    ParameterUninitializedException,
)
from rclpy.executors import Executor, ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node

from cfd_pneumatic.errors import InputError

try:
    from rclpy.experimental import EventsExecutor
except ImportError:  # before Jazzy
    EventsExecutor = None

_SPIN_FOR = 0.5  # EventsExecutor's own spin() does not return on a signal; spin_once with a limit does [s]

_MISTAKES = (
    InputError,
    InvalidParameterTypeException,
    InvalidParameterValueException,
    ParameterUninitializedException,
)


def run(name: str, make_node: Callable[[], Node], args: Sequence[str] | None = None) -> int:
    """
    Run a node until it is interrupted or ROS shuts down; return the program's exit code.

    A mistake in the parameters or files that the user gave is one line on standard error and exit code 2.
    """
    try:
        rclpy.init(args=args)
    except Exception as error:  # rclpy raises types of its own that differ between releases
        return _complain(name, f'the ROS arguments or parameter file cannot be used: {error}')
    node: Node | None = None
    executor: Executor | None = None
    try:
        node = make_node()
        executor = _make_executor()
        executor.add_node(node)
        while rclpy.ok():
            executor.spin_once(timeout_sec=_SPIN_FOR)
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    except SystemExit as done:
        return int(done.code or 0)
    except _MISTAKES as error:
        return _complain(name, str(error))
    finally:
        with suppress(KeyboardInterrupt, ExternalShutdownException):
            if executor is not None:
                executor.shutdown(timeout_sec=1.0)
            if node is not None:
                node.destroy_node()
        rclpy.try_shutdown()
    return 0


def _make_executor() -> Executor:
    """
    Return the executor that hands messages over in the order in which they came.

    A set-point sent just before its sample must act on it; SingleThreadedExecutor hands them over by topic instead.
    """
    return SingleThreadedExecutor() if EventsExecutor is None else EventsExecutor()


def _complain(name: str, message: str) -> int:
    line = ' '.join(message.split())
    print(f'{name}: error: {line}', file=sys.stderr)
    return 2
