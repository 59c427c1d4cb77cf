# SPDX-License-Identifier: Apache-2.0
"""A ROS graph that no other program on this machine or its network takes part in."""

from __future__ import annotations

import atexit
import os
import socket
import sys
import tempfile
from pathlib import Path

_REACH_OTHERS = (
    'FASTDDS_DEFAULT_PROFILES_FILE',
    'FASTRTPS_DEFAULT_PROFILES_FILE',
    'ROS_DISCOVERY_SERVER',
    'ROS_STATIC_PEERS',
)
_HELD: list[socket.socket] = []
_DOMAINS = range(1, 102)  # DDS on Linux: higher ones run into the ports of outgoing connections
_LOCK_PORT = 22119  # ROS 2's own test tools claim a domain by this port plus its number, so that we keep clear of them


def isolate() -> None:
    """Set the environment for rclpy in this process and in those that it starts; call it before rclpy's `init`."""
    for name in _REACH_OTHERS:
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
    os.environ.setdefault('HOME', scratch.name)  # rclpy insists on one

    if Path(sys.prefix, 'share/ament_index/resource_index/packages/rclpy').exists():  # ROS 2 from PyPI's wheels
        prefixes = [sys.prefix, *os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep)]
        os.environ['AMENT_PREFIX_PATH'] = os.pathsep.join(dict.fromkeys(filter(None, prefixes)))
        os.environ.pop('RMW_IMPLEMENTATION', None)  # they have one only


def _claim_domain() -> int:
    """Return a DDS domain that is ours as long as this process lives."""
    for domain in _DOMAINS:
        lock = socket.socket()
        try:
            lock.bind(('127.0.0.1', _LOCK_PORT + domain))
        except OSError:
            lock.close()
            continue
        _HELD.append(lock)
        return domain
    raise RuntimeError('all ROS domains are in use on this machine: end the tests and demos that hold them')
