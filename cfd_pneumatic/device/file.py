# SPDX-License-Identifier: Apache-2.0
"""Read and write `parameters.yaml`, the ROS parameter file of `sim_node` and `monitor_node`."""

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
from cfd_pneumatic.files import YamlMapping, marked, open_input, read_input, read_yaml

REPORT_FILE = 'report.json'
"""Name of the report that `identify_bag` writes next to the parameter file."""

_INDENT = '  '
_RUN = '# identify_bag, run '
_SAVED = '# cfd_pneumatic, parameters of a device'
_LONGEST_LINE = 200
_LONGEST_NAME = 100  # characters of a misspelt name
_LARGEST_REPORT = 2**26  # bytes; ten times a report of hundreds of recordings
_OWNERS = (*CYLINDERS, CONTACT_FORCE)

is_parameter_file = marked(rf'\A({_RUN}|{_SAVED})')
"""Return whether `identify_bag` or `Device.save` wrote a file, from its first line."""


def read(path: Path) -> dict[str, Any]:
    """
    Return the parameters of a device in a file by dotted name, without the parameters of nodes.

    Raises
    ------
    InputError
        If the file cannot be read, or has an unknown name below a cylinder or the contact force.

    """
    check_run(path, path.with_name(REPORT_FILE))
    given = {}
    entries = (entry for parameters in _ros_parameters(read_yaml(path)) for entry in _flattened(parameters))
    for name, value, line in entries:
        if name in DESCRIPTORS:
            given[name] = value
        elif name.partition('.')[0] in _OWNERS:
            near = get_close_matches(name[:_LONGEST_NAME], DESCRIPTORS, n=1)
            hint = f': did you mean {near[0]}?' if near else ''
            raise InputError(f'{path}: line {line}: no parameter of a device has this name{hint}')
    return given


def run_line(run: str) -> str:
    """Return the first line of a file, which names the run of `identify_bag` that wrote the file."""
    return f'{_RUN}{run}'


def saved_text(text: str) -> str:
    """Return the text of a file that `Device.save` writes: a recognisable first line and the parameters."""
    return f'{_SAVED}\n{text}'


def run_of(path: Path) -> str | None:
    """Return the run of `identify_bag` that wrote a file; None if the file names no run."""
    with suppress(InputError, UnicodeDecodeError), open_input(path) as stream:
        line = stream.readline(_LONGEST_LINE).decode().strip()
        if line.startswith(_RUN):
            return line.removeprefix(_RUN)
    return None


def check_run(path: Path, report: Path) -> None:
    """
    Check that a parameter file and its report, if any, are of the same run of `identify_bag`.

    Raises
    ------
    InputError
        If the runs differ: a run was interrupted while it replaced its results, or files were mixed.

    """
    run, reported = run_of(path), _run_of_report(report)
    if run and reported and run != reported:
        raise InputError(f'{path} and {report} are of different runs of identify_bag: identify again')


def report_in(path: Path) -> Any:
    """
    Return the content of a report.json.

    Raises
    ------
    InputError
        If the file cannot be read, is too large, or is not JSON.

    """
    content = read_input(path, _LARGEST_REPORT)
    try:
        return json.loads(content)
    except (ValueError, RecursionError) as error:
        raise InputError('is not a report of identify_bag: it is not JSON') from error


def _run_of_report(report: Path) -> str | None:
    try:
        content = report_in(report)
    except InputError:
        return None  # programs that need a report check it themselves
    run = content.get('run') if isinstance(content, dict) else None
    return run if isinstance(run, str) else None


def text_of(given: Mapping[str, Value], notes: Mapping[str, str]) -> str:
    """Return the text of a file: parameters with units and notes, and notes about parameters that are not given."""
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
            comment = '; '.join(
                part
                for part in (', '.join(filter(None, (descriptor.unit, descriptor.remark))), notes.get(name))
                if part
            )
            lines.append(f'{indent}{leaf}: {_yaml(given[name])}' + (f'  # {comment}' if comment else ''))
        else:
            lines.append(f'{indent}# {leaf} is not given: {notes[name]}')
    return '\n'.join(lines) + '\n'


def _yaml(value: Value) -> str:
    """Return a value as YAML, with a decimal point: rclpy refuses an integer in a list of floats."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, tuple):
        entries = [(entry or "''") if isinstance(entry, str) else _float(entry) for entry in value]
        return f'[{", ".join(entries)}]'
    return _float(value)


def _float(value: float) -> str:
    """Return a number with a decimal point: YAML 1.1 reads 5e-05 as text."""
    digits, exponent, power = repr(float(value)).partition('e')
    return (digits if '.' in digits else f'{digits}.0') + exponent + power


def _ros_parameters(document: Any) -> Iterator[YamlMapping]:
    """Yield the mapping below each `ros__parameters`, for any name of the node."""
    if isinstance(document, YamlMapping):
        for name, below in document.items():
            if name == 'ros__parameters' and isinstance(below, YamlMapping):
                yield below
            else:
                yield from _ros_parameters(below)


def _flattened(values: YamlMapping, above: str = '') -> Iterator[tuple[str, Any, int]]:
    """Yield the dotted name, the value and the line of each leaf of a tree."""
    for name, value in values.items():
        if isinstance(value, YamlMapping):
            yield from _flattened(value, f'{above}{name}.')
        else:
            yield f'{above}{name}', value, values.lines[name]
