# SPDX-License-Identifier: Apache-2.0
"""A further measured signal is one row of the table of roles."""

from __future__ import annotations

import subprocess
import sys

PROGRAM = """\
import sys
from dataclasses import replace
from pathlib import Path

from cfd_pneumatic import convention

second = convention.Role('displacement_2', 'piston_state_2', convention.JOINT_STATE, 'length', 'a second sensor [m]')
convention.ROLES = {**convention.ROLES, second.name: second}

from cfd_pneumatic.recording import Signal, read_recording, recording_of, write_recording
from cfd_pneumatic.rig import paper_step, record

folder = Path(sys.argv[1])
made = recording_of(record(paper_step()))
first = made.displacement
write_recording(folder / 'bag', replace(made, others={'displacement_2': Signal(first.times, first.values + 1e-3)}))
print(read_recording(folder / 'bag').others['displacement_2'].values[0] - first.values[0])
table = ''.join(f'{time},{1e3 * x},{1e3 * x + 1},2\\n' for time, x in zip(first.times, first.values))
(folder / 'table.csv').write_text(table)
(folder / 'mapping.yaml').write_text('''
table: {time: {column: 1, unit: s}, delimiter: comma}
displacement: {column: 2, unit: mm}
displacement_2: {column: 3, unit: mm}
cylinder_a: {pressure: {column: 4, unit: bar, reference: absolute}}
''')
read = read_recording(folder / 'table.csv', mapping=folder / 'mapping.yaml')
print(read.others['displacement_2'].values[0] - read.displacement.values[0])
"""


def test_a_second_displacement_is_mapped_written_and_read(tmp_path):
    run = [sys.executable, '-c', PROGRAM, str(tmp_path)]
    done = subprocess.run(run, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert [round(float(line), 9) for line in done.stdout.split()] == [1e-3, 1e-3]
