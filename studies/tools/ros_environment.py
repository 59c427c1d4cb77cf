# SPDX-License-Identifier: Apache-2.0
"""Isolate a ROS graph from all other programs on this machine and its network."""

from __future__ import annotations

import atexit
import os
import socket
import sys
import tempfile
from pathlib import Path

_DISCOVERY_VARIABLES = (
    'FASTDDS_DEFAULT_PROFILES_FILE',
    'FASTRTPS_DEFAULT_PROFILES_FILE',
    'ROS_DISCOVERY_SERVER',
    'ROS_STATIC_PEERS',
)
_DOMAIN_LOCKS: list[socket.socket] = []
_DOMAINS = range(1, 102)  # on Linux, ports of higher domains collide with outgoing connections
_LOCK_PORT = 22119  # plus the domain: the port by which the test tools of ROS 2 claim a domain


def isolate() -> None:
    """Set the environment of rclpy in this process and its children; call before `rclpy.init`."""
    for name in _DISCOVERY_VARIABLES:
        os.environ.pop(name, None)
    if os.environ.get('ROS_DISTRO') == 'humble':
        os.environ['ROS_LOCALHOST_ONLY'] = '1'
    else:
        os.environ.pop('ROS_LOCALHOST_ONLY', None)
        os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
    os.environ['ROS_DOMAIN_ID'] = str(_claim_domain())

    scratch = tempfile.TemporaryDirectory(prefix='cfd_pneumatic-', ignore_cleanup_errors=True)
    atexit.register(scratch.cleanup)
    os.environ['ROS_LOG_DIR'] = scratch.name
    os.environ.setdefault('HOME', scratch.name)  # rclpy requires HOME

    if Path(sys.prefix, 'share/ament_index/resource_index/packages/rclpy').exists():  # ROS 2 from PyPI's wheels
        prefixes = [sys.prefix, *os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep)]
        os.environ['AMENT_PREFIX_PATH'] = os.pathsep.join(dict.fromkeys(filter(None, prefixes)))
        os.environ.pop('RMW_IMPLEMENTATION', None)  # the wheels have a single middleware


def _claim_domain() -> int:
    """Claim a DDS domain until this process ends, and return its number."""
    for domain in _DOMAINS:
        lock = socket.socket()
        try:
            lock.bind(('127.0.0.1', _LOCK_PORT + domain))
        except OSError:
            lock.close()
            continue
        _DOMAIN_LOCKS.append(lock)
        return domain
    raise RuntimeError('all ROS domains are in use on this machine. End the tests and demos that use them.')
