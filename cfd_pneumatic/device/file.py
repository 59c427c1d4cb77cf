# SPDX-License-Identifier: Apache-2.0
"""`parameters.yaml`: a ROS parameter file that `sim_node` and `monitor_node` run with as it is."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from contextlib import suppress
from difflib import get_close_matches
from pathlib import Path
from typing import Any

from cfd_pneumatic.convention import CONTACT_FORCE, CYLINDERS
from cfd_pneumatic.device.descriptors import DESCRIPTORS, Value
from cfd_pneumatic.errors import InputError
from cfd_pneumatic.yaml_files import read_yaml

REPORT_FILE = 'report.json'
"""What `identify_bag` writes beside it."""

_INDENT = '  '
_RUN = '# identify_bag, run '
_LONGEST_LINE = 200
_LARGEST_REPORT = 2**26  # bytes; with hundreds of recordings it has a tenth of that
_OWNERS = (*CYLINDERS, CONTACT_FORCE)


def read(path: Path) -> dict[str, Any]:
    """
    Return a device's parameters in a file, by their dotted names; those of the nodes themselves are left out.

    Raises
    ------
    InputError
        If it can't be read, or something below a cylinder or the contact force is no parameter.

    """
    check_run(path, path.with_name(REPORT_FILE))
    given = dict(_flat(_ros_parameters(read_yaml(path))))
    for name in given:
        if name not in DESCRIPTORS and name.partition('.')[0] in _OWNERS:
            near = get_close_matches(name, DESCRIPTORS, n=1)
            raise InputError(f'{path}: {name} is no parameter of a device' + (f': is {near[0]} meant?' if near else ''))
    return {name: value for name, value in given.items() if name in DESCRIPTORS}


def run_line(run: str) -> str:
    """Return the line that names the run of `identify_bag` which a file and its report come from."""
    return f'{_RUN}{run}'


def run_of(path: Path) -> str | None:
    """Return the run that a file comes from; None where it names none."""
    with suppress(OSError, UnicodeDecodeError), path.open(encoding='utf-8') as stream:
        line = stream.readline(_LONGEST_LINE).strip()
        if line.startswith(_RUN):
            return line.removeprefix(_RUN)
    return None


def check_run(path: Path, report: Path) -> None:
    """
    Make sure that a file and a report, where there is one, come from the same run of `identify_bag`.

    Raises
    ------
    InputError
        If they name different ones: a run was ended while its results took their places, or files were mixed.

    """
    own, reported = run_of(path), _run_of_report(report)
    if own and reported and own != reported:
        raise InputError(f'{path} is of run {own} of identify_bag, and {report} of run {reported}: identify again')


def report_in(path: Path) -> Any:
    """
    Return what a report.json holds.

    Raises
    ------
    OSError
        If it can't be read.
    ValueError
        If it is none.

    """
    with path.open('rb') as file:
        content = file.read(_LARGEST_REPORT)
    try:
        return json.loads(content)
    except RecursionError as error:
        raise ValueError('is nested too deeply') from error


def _run_of_report(report: Path) -> str | None:
    try:
        content = report_in(report)
    except (OSError, ValueError):
        return None  # who needs a report says what is wrong with it
    run = content.get('run') if isinstance(content, dict) else None
    return run if isinstance(run, str) else None


def text_of(given: Mapping[str, Value], notes: Mapping[str, str]) -> str:
    """Return the text of a file: parameters with their units and notes, notes alone of what is not given."""
    lines = ['/**:', f'{_INDENT}ros__parameters:']
    above: list[str] = []
    for name, descriptor in DESCRIPTORS.items():
        if name not in given and name not in notes:
            continue
        *groups, leaf = name.split('.')
        for depth, group in enumerate(groups):
            if above[: depth + 1] != groups[: depth + 1]:
                lines.append(f'{_INDENT * (2 + depth)}{group}:')
        above = groups
        indent = _INDENT * (2 + len(groups))
        if name in given:
            beside = '; '.join(
                part
                for part in (', '.join(filter(None, (descriptor.unit, descriptor.remark))), notes.get(name))
                if part
            )
            lines.append(f'{indent}{leaf}: {_yaml(given[name])}' + (f'  # {beside}' if beside else ''))
        else:
            lines.append(f'{indent}# {leaf} is left out: {notes[name]}')
    return '\n'.join(lines) + '\n'


def _yaml(value: Value) -> str:
    """Return a value that every reader takes for what it is; an integer in a list of floats would stop rclpy."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, tuple):
        entries = [(one or "''") if isinstance(one, str) else _float(one) for one in value]
        return f'[{", ".join(entries)}]'
    return _float(value)


def _float(value: float) -> str:
    """Return a number with a decimal point, without which YAML 1.1 reads 5e-05 as text."""
    digits, exponent, power = repr(float(value)).partition('e')
    return (digits if '.' in digits else f'{digits}.0') + exponent + power


def _ros_parameters(document: Any) -> dict[str, Any]:
    """Return what stands below `ros__parameters`, whatever the node is called."""
    found: dict[str, Any] = {}
    if isinstance(document, dict):
        for name, below in document.items():
            found |= below if name == 'ros__parameters' and isinstance(below, dict) else _ros_parameters(below)
    return found


def _flat(values: Mapping[str, Any], above: str = '') -> Iterator[tuple[str, Any]]:
    """Yield the dotted names and the values of a tree."""
    for name, value in values.items():
        if isinstance(value, dict):
            yield from _flat(value, f'{above}{name}.')
        else:
            yield f'{above}{name}', value
