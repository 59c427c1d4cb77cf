"""Every node's main, ended by a signal at a bad moment."""

from __future__ import annotations

import subprocess
import sys

import pytest

PROGRAM = """
import os, signal, sys, time
import rclpy
from rclpy.node import Node
from cfd_pneumatic.nodes.program import run

def end(number):
    os.kill(os.getpid(), number)
    while rclpy.ok():
        time.sleep(0.01)

class Ended(Node):
    def __init__(self):
        if {while_made}:
            end(signal.SIGTERM)
        super().__init__('ended')
        self.create_timer(0.01, self.work)

    def work(self):
        end(signal.{name})
        self.create_timer(1.0, print)

    def destroy_node(self):
        os.kill(os.getpid(), signal.SIGINT)
        print('what has to be finished is', end=' ')
        super().destroy_node()
        print('finished')

sys.exit(run('ended', Ended, []))
"""
"""A node that ends itself: ROS is gone in the middle of its work, and an interrupt comes while it finishes."""


@pytest.mark.parametrize(
    ('name', 'while_made', 'said'),
    [
        ('SIGTERM', True, ''),
        ('SIGTERM', False, 'what has to be finished is finished\n'),
        ('SIGINT', False, 'what has to be finished is finished\n'),
    ],
)
def test_a_signal_at_a_bad_moment_ends_it_without_a_complaint(name: str, while_made: bool, said: str) -> None:
    program = PROGRAM.format(name=name, while_made=while_made)
    ended = subprocess.run([sys.executable, '-c', program], capture_output=True, text=True, check=False)
    assert (ended.returncode, ended.stdout) == (0, said), ended.stderr
    assert 'Traceback' not in ended.stderr
