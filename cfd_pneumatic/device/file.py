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
from cfd_pneumatic.files import YamlMapping, marked, open_input, read_input, read_yaml

REPORT_FILE = 'report.json'
"""What `identify_bag` writes beside it."""

_INDENT = '  '
_RUN = '# identify_bag, run '
_SAVED = '# cfd_pneumatic, parameters of a device'
_LONGEST_LINE = 200
_LONGEST_NAME = 100  # characters of a name that may be a misspelt one
_LARGEST_REPORT = 2**26  # bytes; with hundreds of recordings it has a tenth of that
_OWNERS = (*CYLINDERS, CONTACT_FORCE)

is_parameter_file = marked(rf'\A({_RUN}|{_SAVED})')
"""Recognises a file by its first line, which `identify_bag` and `Device.save` write."""


def read(path: Path) -> dict[str, Any]:
    """
    Return a device's parameters in a file, by their dotted names; those of the nodes themselves are left out.

    Raises
    ------
    InputError
        If it can't be read, or something below a cylinder or the contact force is no parameter.

    """
    check_run(path, path.with_name(REPORT_FILE))
    given = {}
    flat = (one for parameters in _ros_parameters(read_yaml(path)) for one in _flat(parameters))
    for name, value, line in flat:
        if name in DESCRIPTORS:
            given[name] = value
        elif name.partition('.')[0] in _OWNERS:
            near = get_close_matches(name[:_LONGEST_NAME], DESCRIPTORS, n=1)
            meant = f': did you mean {near[0]}?' if near else ''
            raise InputError(f'{path}: line {line}: no parameter of a device has this name{meant}')
    return given


def run_line(run: str) -> str:
    """Return the line that names the run of `identify_bag` which a file and its report come from."""
    return f'{_RUN}{run}'


def saved_text(text: str) -> str:
    """Return what is written of a device's text: below the line by which the file is recognised."""
    return f'{_SAVED}\n{text}'


def run_of(path: Path) -> str | None:
    """Return the run that a file comes from; None where it names none."""
    with suppress(InputError, UnicodeDecodeError), open_input(path) as stream:
        line = stream.readline(_LONGEST_LINE).decode().strip()
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
        raise InputError(f'{path} and {report} are of different runs of identify_bag: identify again')


def report_in(path: Path) -> Any:
    """
    Return what a report.json holds.

    Raises
    ------
    InputError
        If it can't be read, is too large, or is no JSON.

    """
    content = read_input(path, _LARGEST_REPORT)
    try:
        return json.loads(content)
    except (ValueError, RecursionError) as error:
        raise InputError('is no report of identify_bag: it is not JSON') from error


def _run_of_report(report: Path) -> str | None:
    try:
        content = report_in(report)
    except InputError:
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


def _ros_parameters(document: Any) -> Iterator[YamlMapping]:
    """Yield what stands below each `ros__parameters`, whatever the node is called."""
    if isinstance(document, YamlMapping):
        for name, below in document.items():
            if name == 'ros__parameters' and isinstance(below, YamlMapping):
                yield below
            else:
                yield from _ros_parameters(below)


def _flat(values: YamlMapping, above: str = '') -> Iterator[tuple[str, Any, int]]:
    """Yield the dotted names, the values and the lines of a tree."""
    for name, value in values.items():
        if isinstance(value, YamlMapping):
            yield from _flat(value, f'{above}{name}.')
        else:
            yield f'{above}{name}', value, values.lines[name]
