# SPDX-License-Identifier: Apache-2.0
"""The paper's model alone on a real cylinder, set-points estimated."""

import pytest
from measured import MAPPING, ROOT, needs_measured_data

from cfd_pneumatic.identification import identify
from cfd_pneumatic.recording import read_mapping, read_recording

HEALTHY = (
    'friction/O-ring257_1bar',
    'friction/O-ring257_3bar',
    'friction/O-ring257_5bar',
    'friction/O-ring257_7bar',
    'rerun/2_O-ring257_3bar',
)


@needs_measured_data
@pytest.mark.parametrize('run', HEALTHY)
def test_healthy_runs_are_simulated_to_four_percent(run, capsys):
    recording = read_recording(ROOT / f'{run}.csv', mapping=read_mapping(MAPPING))
    result = identify([recording]).channels['cylinder_a']
    with capsys.disabled():
        print(f'\n{run}: test part {result.before["test"].nrmse_percent:.2f} % of span', end='')
    assert result.before['test'].nrmse_percent <= 4.0
    bar = float(run.split('_')[-1][0])
    assert result.schedule[0].setpoint == pytest.approx(bar * 1e5, rel=0.06)
