# SPDX-License-Identifier: Apache-2.0
"""A law of the force that no effect of the library is: where it enters, its curve, and when none is drawn."""

from __future__ import annotations

import importlib.util
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from drawn import both_cylinders, experiments_of
from reference import AMBIENT

from cfd_pneumatic.device import Device
from cfd_pneumatic.device.identified import identified_device
from cfd_pneumatic.identification import ChannelResult, Identification, Options, identify
from cfd_pneumatic.identification.channels.force import Force
from cfd_pneumatic.identification.fit.fit import fit_model
from cfd_pneumatic.identification.loop import close_loop
from cfd_pneumatic.model.effects import ForceMoment
from cfd_pneumatic.model.effects.force_curve import FORCE_CURVE
from cfd_pneumatic.recording import recording_of
from cfd_pneumatic.reporting import draft_effect
from cfd_pneumatic.reporting.data import report_data
from cfd_pneumatic.rig import device_named, record, surface_following
from cfd_pneumatic.rig.schedule import Schedule
from studies.panel import CLASSES, Draw, draw, force_oracle_residual

SURFACE = surface_following(60e3, 1.5e-3, setpoint_steps=20e3, duration=12.0, seed=0)
LAWS = {'scarred_bore': (2.0, SURFACE), 'bent_cell': (0.1, SURFACE), 'cable_bundle': (3.0, 'out_and_back')}
"""How strong they are, and a motion that shows them."""

MOMENT = ForceMoment(0.0, 0.0, 0.0, 0.0, 2e5, 1.5e5, 1e5)


@cache
def drawn(law: str) -> Draw:
    strength, schedule = LAWS[law]
    return draw(law, schedule, 0, given={law: strength})


@cache
def identified(law: str) -> Identification:
    return identify([both_cylinders(drawn(law))], Options(close_loop=True))


def found(law: str) -> ChannelResult:
    return identified(law).channels['force']


def rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


@pytest.mark.parametrize('law', LAWS)
def test_a_law_that_is_in_no_library_is_drawn_where_it_enters(law: str) -> None:
    result = found(law)
    findings, judged = result.findings, result.judged(result.comparisons[0])
    assert (findings.verdict, findings.effects) == ('shape_found', ())
    assert findings.unknown is not None
    assert CLASSES[law] & {(findings.unknown.enters, findings.unknown.against), *findings.unknown.alternatives}
    assert result.rmse(1) < 1.05 * rms(force_oracle_residual(drawn(law))[judged])
    assert result.rmse(1) < 0.5 * result.rmse(0)
    assert all(one.conclusion.unknown is None for one in identified(law).cylinders.values())


def test_the_curve_is_the_law() -> None:
    shape, changes = found('scarred_bore').findings.unknown, drawn('scarred_bore').truth.changes
    assert shape is not None
    place, length = changes['odd_force.scar_position'], changes['odd_force.scar_length']
    seen = shape.visited
    true = changes['odd_force.scar'] * np.exp(-(((shape.at[seen] - place) / length) ** 2))
    assert rms(shape.value[seen] - true) < 0.03 * np.ptp(true)
    assert np.mean((shape.low[seen] < true) & (true < shape.high[seen])) > 0.9
    presliding = found('scarred_bore').found.model.effects[FORCE_CURVE][2]
    assert presliding == pytest.approx(changes['seal.presliding'], rel=0.2)


def test_a_bent_cell_reads_less_the_more_it_bears() -> None:
    shape, bend = found('bent_cell').findings.unknown, drawn('bent_cell').truth.changes['odd_force.bend']
    assert shape is not None
    slope, _ = np.polyfit(shape.at[shape.visited], shape.value[shape.visited], 1)
    assert slope == pytest.approx(-bend, rel=0.25), 'of the force as the area makes it'


def test_it_stands_in_the_report_and_runs_in_the_device(tmp_path: Path) -> None:
    identification = identified('cable_bundle')
    law = report_data(identification)['force']['unknown']
    assert (law['enters'], law['against'], law['unit'], law['unit_against']) == ('force', 'x', 'N', 'm')
    assert 'cables' in law['words']
    assert len({len(law['curve'][name]) for name in ('at', 'value', 'low', 'high')}) == 1
    identified_device(identification).save(tmp_path / 'parameters.yaml')
    device = Device.load(tmp_path / 'parameters.yaml')
    expected = identification.channels['force'].found.model.effects
    assert device.model.force_effects[FORCE_CURVE] == pytest.approx(expected[FORCE_CURVE], rel=1e-5)
    recording = both_cylinders(drawn('cable_bundle'))
    assert recording.force is not None
    simulated = device.simulate(recording, measured_pressures=True).force
    assert simulated is not None
    left = simulated.values - np.interp(simulated.times, recording.force.times, recording.force.values)
    assert rms(left) < 1.05 * rms(force_oracle_residual(drawn('cable_bundle')))


def test_a_draft_of_an_effect_does_what_the_formula_says(tmp_path: Path) -> None:
    path = tmp_path / 'scored_bore.py'
    path.write_text(draft_effect(identified('scarred_bore'), 'scored_bore'))
    spec = importlib.util.spec_from_file_location('scored_bore', path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    own, _ = module.EFFECT.starts({})
    assert len(own) == len(module.EFFECT.parameters)
    assert (module.EFFECT.states, module.EFFECT.follows) == (1, 'motion')
    shape = found('scarred_bore').findings.unknown
    assert shape is not None
    at, value = shape.at[shape.visited], shape.value[shape.visited]
    told = np.array([7.0 - module.force(7.0, MOMENT._replace(x=x), 1.0, *own) for x in at])
    assert rms(told - value) < 0.05 * np.ptp(value)
    (stretch,) = module.slide(1e-2, -1.0, *own)
    assert stretch == pytest.approx(1.0)


def test_a_law_is_told_from_friction_and_mass_that_a_real_device_has() -> None:
    """Friction that takes the length of a stroke to turn round passes for the cables, before they are known."""
    device = device_named('real', 'odd_force.bundle=3000 odd_force.bundle_slack=4e-4')
    recording = recording_of(record(surface_following(duration=12.0, seed=0), device, seed=1), 'played')
    channel = Force(None, 1.0, AMBIENT)
    _, findings = close_loop(fit_model(channel, experiments_of([recording], channel)))
    assert findings.verdict == 'shape_found'
    assert findings.unknown is not None
    assert (findings.unknown.enters, findings.unknown.against) == ('force', 'x')
    assert set(findings.effects) == {'seal_friction', 'moving_mass'}


def test_where_nobody_knows_the_area_no_law_is_claimed() -> None:
    schedule = surface_following(60e3, 1.5e-3, setpoint_steps=0.0, duration=12.0, seed=0)
    recording = both_cylinders(draw('cable_bundle', schedule, 1))
    for area in (None, 1.14e-3):
        result = identify([recording], Options(close_loop=True, area=area)).channels['force']
        assert (result.findings.unknown is not None) == (area is not None)


@pytest.mark.parametrize(
    ('effect', 'schedule', 'seed'),
    [
        ('moving_mass', 'out_and_back', 4),  # of which samples 2 ms apart do not resolve the strokes
        ('seal_friction', 'paper_step', 3),  # nothing is left to check a curve on
        ('seal_friction', SURFACE, 4),
        (None, SURFACE, 5),
    ],
)
def test_an_effect_of_the_library_or_nothing_is_no_law(effect: str | None, schedule: str | Schedule, seed: int) -> None:
    result = identify([both_cylinders(draw(effect, schedule, seed))], Options(close_loop=True)).channels['force']
    assert result.findings.unknown is None
