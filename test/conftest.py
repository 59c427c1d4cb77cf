"""A ROS graph of its own for the tests, and a word on those that can't run here."""

from __future__ import annotations

import sys
from pathlib import Path

sys.path[:0] = [str(Path(__file__).parents[1] / 'scripts'), str(Path(__file__).parent)]

from ros_environment import isolate  # noqa: E402

isolate()

try:
    import rclpy  # noqa: F401
except ImportError as error:
    WITHOUT_ROS = f'test/nodes is left out: ROS 2 is not to be had here ({error})'
    collect_ignore = ['nodes']
else:
    WITHOUT_ROS = ''


def pytest_terminal_summary(terminalreporter):
    if WITHOUT_ROS:
        terminalreporter.write_line(WITHOUT_ROS, yellow=True)
