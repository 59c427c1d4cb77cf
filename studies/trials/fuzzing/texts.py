# SPDX-License-Identifier: Apache-2.0
"""Try text files: tables, mappings, parameters, schedules, message definitions, reports."""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Callable, Iterable, Sequence
from io import StringIO
from pathlib import Path
from random import Random

import numpy as np
import yaml
from rosbags.interfaces import Connection, MessageDefinition, MessageDefinitionFormat
from rosbags.rosbag2 import CompressionMode
from rosbags.typesys import get_types_from_msg

from cfd_pneumatic.convention import SCHEDULE_COLUMNS
from cfd_pneumatic.device import Device
from cfd_pneumatic.errors import InputError, without_quotations
from cfd_pneumatic.identification import identify
from cfd_pneumatic.messages import Definitions
from cfd_pneumatic.planning import Limits, read_report
from cfd_pneumatic.recording import read_recording, recording_of
from cfd_pneumatic.reporting import write_report
from cfd_pneumatic.rig import paper_step, record, written_schedule
from studies.trials.fuzzing.bags import by_rosbags, check, contents
from studies.trials.fuzzing.campaign import Fault, Input, Kind
from studies.trials.fuzzing.mutators import DEFINITION, JSON, SECRET, TEXT, Mutator, mutated

MAPPINGS = (
    """\
table:
  time: {column: 1, unit: ms}
  skip_rows: 1
displacement: {column: 2, unit: mm, sign: -1}
cylinder_a:
  pressure: {column: 3, unit: bar, reference: gauge}
  setpoint: {column: 4, unit: kPa, reference: absolute}
force: {column: 5, unit: N, offset: 1.5}
""",
    """\
table:
  time: {column: t, unit: s}
  delimiter: comma
  header_rows: 1
displacement: {column: x, unit: m}
cylinder_a: {pressure: {column: p, unit: psi, reference: gauge}}
cylinder_b: {pressure: {column: q, unit: Pa, reference: absolute}}
others: {temperature: {column: f, unit: N}}
""",
    """\
displacement: {topic: /cfd/device/piston_state, field: "position[piston]", unit: m, stamp: receive}
cylinder_a:
  pressure:
    {topic: /cfd/device/cylinder_a/pressure, unit: Pa, reference: absolute, stamp: header.stamp, time_offset: 0.01}
  setpoint: {topic: /cfd/device/cylinder_a/setpoint, field: data, unit: psi, scale: 25/5, reference: gauge}
""",
)

TABLES = (
    ''.join(f'{10 * i} {0.1 * i:.3f} {1 + 0.01 * i:.4f} {200 + i} {i % 5}\n' for i in range(40)),
    't,x,p,q,f\n' + ''.join(f'{0.01 * i:.2f},{1e-4 * i:.5f},{10 + 0.1 * i:.3f},{2e5 + i},{i % 7}\n' for i in range(40)),
)
"""A table for each of the first mappings; the last mapping is for bags."""

PARAMETERS = """\
/**:
  ros__parameters:
    area: 1.14e-3  # m^2
    geometric_factor: 1.0
    cylinder_a:
      enabled: true
      setpoints: [34473.8, 68947.6]  # Pa
      k_x: [4.3e+06, 5.4e+06]
      k_sv: [104.3, 164.5]
      k_v: [19.4, 30.4]
      tau: [0.0105, 0.0123]
      not_identifiable: [k_v]
      leakage: {enabled: true, conductance: 0.2}
    cylinder_b.k_x: [4.3e+06]
    cylinder_b.setpoints: [34473.8]
    cylinder_b.k_sv: [104.0]
    cylinder_b.k_v: [20.0]
    cylinder_b.tau: [0.01]
    contact_force.seal_friction.enabled: true
"""

SCHEDULE = '\n'.join(
    [','.join(SCHEDULE_COLUMNS), '0,0,0,3e4,3e4', '0.5,0.001,0.01,3e4,3e4', '1.5,-0.002,0,5e4,3e4', '2,0,0,5e4,4e4']
)

DEFINITIONS = (
    'uint64 t_us\nstring state\nacme_msgs/Channel[] channels\nfloat32[4] analog\nfloat64[<=8] more\nuint8 KIND=3\n'
    '================================================================================\n'
    'MSG: acme_msgs/Channel\nstring<=16 label "a"\nfloat64 reading 1.5\n',
    'std_msgs/Header header\nstring[] name\nfloat64[] position\n'
    '================================================================================\n'
    'MSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n'
    '================================================================================\n'
    'MSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n',
)


class Text(Kind):
    """
    Text files of a format.

    Parameters
    ----------
    name
        Name of the kind.
    file
        Name of the file.
    seeds
        Function that returns valid texts, each with further files that are not changed.
    read
        Function that reads the file.
    parse
        Parser of the format; raises an exception if a text is not of the format.
    mutators
        Functions that change the text.
    names_types
        Whether error messages may name the types in the file.

    """

    def __init__(
        self,
        name: str,
        file: str,
        seeds: Callable[[Path], Iterable[dict[str, str]]],
        read: Callable[[Path], object],
        parse: Callable[[str], object],
        mutators: Sequence[Mutator] = TEXT,
        names_types: bool = False,
    ) -> None:
        self.name, self._mutators, self._names_types = name, mutators, names_types
        self._file, self._seeds, self._read, self._parse = file, seeds, read, parse

    def start(self, folder: Path) -> None:
        """Make the valid texts."""
        self._path = folder / self._file
        self._valid = [
            Input({name: text.encode() for name, text in files.items()}, about=f'{number}')
            for number, files in enumerate(self._seeds(folder))
        ]
        self._written: dict[str, bytes] = {}

    def valid(self, rng: Random) -> Input:
        """Return a valid text."""
        return rng.choice(self._valid)

    def changed(self, parent: Input, rng: Random) -> Input:
        """Return the input with a changed file."""
        return parent.changed(self._file, mutated(parent.files[self._file], rng, self._mutators))

    def give(self, case: Input) -> str:
        """Read the file."""
        for name, content in case.files.items():
            if self._written.get(name) != content:
                self._path.with_name(name).write_bytes(content)
        self._written = case.files
        try:
            self._read(self._path)
        except InputError as error:
            message = without_quotations(str(error))  # cells of a table may be quoted
            if not self._names_types and any(SECRET[at : at + 6].decode() in message for at in range(len(SECRET) - 5)):
                raise Fault(f'the error quotes a file: {error}') from error
            raise
        return ''

    def parses(self, case: Input) -> bool:
        """Return whether the text is of its format."""
        try:
            self._parse(case.files[self._file].decode('utf-8-sig'))
        except Exception:  # the parser raises many types of exceptions
            return False
        return True


def _mappings(folder: Path) -> Iterable[dict[str, str]]:
    by_rosbags('mcap', CompressionMode.NONE, alone=0.0)(folder, contents(Random(4))[0], Random(4))
    for number, mapping in enumerate(MAPPINGS):
        yield {'mapping.yaml': mapping, 'recording': TABLES[number] if number < len(TABLES) else ''}


def _mapped(mapping: Path) -> None:
    table = mapping.with_name('recording')
    check(read_recording(table if table.stat().st_size else table.with_name('bag'), mapping=mapping))


def _tables(_: Path) -> Iterable[dict[str, str]]:
    for mapping, table in zip(MAPPINGS, TABLES):
        yield {'table.csv': table, 'mapping.yaml': mapping}


def _table(file: Path) -> None:
    check(read_recording(file, mapping=file.with_name('mapping.yaml')))


def _rows(text: str) -> None:
    """Raise ValueError if a text has no row of five finite numbers below its header."""
    delimiter = max(', ', key=text.count)
    rows = list(csv.reader(StringIO(text), delimiter=delimiter))
    if not any(len(row) >= 5 and all(map(math.isfinite, map(float, row))) for row in rows[1:]):
        raise ValueError('no row of numbers')


def _parameters(file: Path) -> None:
    for name, value in Device.load(file).given.items():
        for number in value if isinstance(value, Sequence) else [value]:
            if isinstance(number, float) and not math.isfinite(number):
                raise Fault(f'the parameter {name} is {number}')


def _schedule(file: Path) -> None:
    schedule = written_schedule(file)
    for column in (schedule.positions, schedule.velocities, schedule.setpoints):
        if not np.isfinite(column).all():
            raise Fault('a schedule has numbers that are not finite')


def _definition(file: Path) -> None:
    text = file.read_bytes().decode(errors='replace')  # as the reader of bags does
    definition = MessageDefinition(MessageDefinitionFormat.MSG, text)
    connection = Connection(1, '/x', 'acme_msgs/msg/Press', definition, '', 1, None, None)  # type: ignore[arg-type]
    Definitions().for_topic([connection])


def _report(file: Path) -> None:
    sensing, stroke = read_report(file)
    Limits((0.0, 1e5), stroke)
    if not (0.0 <= sensing.pressure_noise < math.inf and 0.0 < sensing.sample_rate < math.inf):
        raise Fault(f'a report gives {sensing}')


def _reports(folder: Path) -> Iterable[dict[str, str]]:
    """Yield the parts of an identification's report that plan_experiment reads."""
    write_report(identify([recording_of(record(paper_step()), 'step', 10**18)]), folder)
    report = json.loads((folder / 'report.json').read_text(encoding='utf-8'))
    yield {'report.json': json.dumps({name: report[name] for name in ('schema', 'recordings', 'cylinders')}, indent=1)}


def kinds() -> list[Kind]:
    """Return all kinds of texts."""
    return [
        Text('mapping files', 'mapping.yaml', _mappings, _mapped, yaml.safe_load),
        Text('tables', 'table.csv', _tables, _table, _rows),
        Text('parameter files', 'device.yaml', lambda _: [{'device.yaml': PARAMETERS}], _parameters, yaml.safe_load),
        Text('schedules', 'schedule.csv', lambda _: [{'schedule.csv': SCHEDULE}], _schedule, _rows),
        Text(
            'message definitions',
            'Press.msg',
            lambda _: [{'Press.msg': text} for text in DEFINITIONS],
            _definition,
            lambda text: get_types_from_msg(text, 'acme_msgs/msg/Press'),
            DEFINITION,
            names_types=True,
        ),
        Text('report.json', 'report.json', _reports, _report, json.loads, JSON),
    ]
