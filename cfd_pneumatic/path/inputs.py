# SPDX-License-Identifier: Apache-2.0
"""Read the path of the piston from a table or a bag."""

from __future__ import annotations

from pathlib import Path

from cfd_pneumatic.errors import InputError
from cfd_pneumatic.path.motion import PathMotion, Surface
from cfd_pneumatic.path.path_bags import AXES, read_path_bag
from cfd_pneumatic.path.path_tables import read_path_table
from cfd_pneumatic.recording import ROS1_SUFFIX, SUFFIXES


def read_path(path: Path, *, joint: str = '', axis: str = '', topic: str = '') -> Surface | PathMotion:
    """
    Read the distance of a surface from the taught path, or the displacement of the piston over time.

    Parameters
    ----------
    path : Path
        A table with the columns `along_UNIT,error_UNIT` or `time_UNIT,displacement_UNIT`, or a bag. A bag is a folder
        or a file; it holds `piston_state`, a nav_msgs/Path or a trajectory_msgs/JointTrajectory.
    joint : str
        Name of the piston among the joints of a bag; by default the only joint, or the joint `piston`.
    axis : str
        Axis of a nav_msgs/Path along which the piston moves, x, y or z; by default z.
    topic : str
        Topic of a bag; by default the only topic that holds a path.

    Returns
    -------
    Surface or PathMotion
        A `Surface` from positions along the path, a `PathMotion` from times.

    Raises
    ------
    InputError
        If the file or folder does not hold exactly one path.

    """
    if axis not in ('', *AXES):
        raise InputError(f'the path has no axis {axis!r}: choose one of {", ".join(AXES)}')
    try:
        if path.is_dir() or path.suffix in (*SUFFIXES, ROS1_SUFFIX):
            return read_path_bag(path, joint=joint, axis=axis or 'z', topic=topic)
        return read_path_table(path)
    except InputError as error:
        raise InputError(f'{path}: {error}') from error
