# SPDX-License-Identifier: Apache-2.0
"""
Document every physical effect: make effects-document writes docs/reference/effects.md and docs/reference/effects/*.svg.

The text comes from the effects' files. The pictures come from the virtual rig, which shares no physics with the model.
They show a device with the effect, minus the model of the healthy device.
"""

from __future__ import annotations

import io
import re
from collections.abc import Iterator
from typing import NamedTuple

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy.signal import periodogram

from cfd_pneumatic.arrays import Array
from cfd_pneumatic.convention import AMBIENT_PRESSURE
from cfd_pneumatic.files import write_text
from cfd_pneumatic.identification import ChannelResult, Options, identify
from cfd_pneumatic.model import EFFECTS, FORCE_EFFECTS, FUNCTIONS, MODULES, Effect
from cfd_pneumatic.rig import Cylinder, Sensors, surface_following
from cfd_pneumatic.units import PSI
from studies.documents.markdown import code, table
from studies.panel import EFFECTS as ON_RIG
from studies.panel import Draw, draw
from studies.panel.rows import cylinder_a_of
from studies.panel.scores import FAMILIES
from studies.tools.provenance import ROOT

DOCUMENT = ROOT / 'docs' / 'reference' / 'effects.md'
PICTURES = ROOT / 'docs' / 'reference' / 'effects'

CYLINDER = 'cylinder_a'
SEED = 9
"""Seed of a device with a seal that lifts in both directions and with late pressures."""

SCHEDULE = surface_following(9.0 * PSI, 1.8e-3, setpoint_steps=3.0 * PSI, bandwidth=6.0, duration=24.0, seed=1)
SHOWN = 5.0
"""Duration of the plots over time [s]."""

STRENGTH = 0.75
"""Strength of a plotted effect: 0 is the weakest, 1 the strongest, on a logarithmic scale."""

EVERY = 20
"""Number of samples for each dot."""

HEALTHY, REFITTED = '#1f77b4', '#ff7f0e'

SYMBOLS = r"""
| symbol | meaning |
| --- | --- |
| $x$ | measured displacement; a positive displacement enlarges the chamber |
| $p$ | pressure in the cylinder |
| $p_f$ | pressure that the regulator senses; $p_r$ at its outlet |
| $p_d$ | set-point |
| $p_0$ | ambient pressure |
| $e$ | valve error, $p_d - p_f$ |
| $q$ | pressure rate of the valve's flow, $K\,e$ |
| $s$ | pressure that the sensor reads |
| $F$ | contact force |
| $\psi(r)$ | flow function of ISO 6358: 1 up to $r = 0.528$, then $\sqrt{1 - ((r - 0.528) / 0.472)^2}$ |
""".strip()


# text


def document() -> str:
    """Return the document in Markdown, without a simulation."""
    return '\n\n'.join([*_opening(), *(part for name in sorted(EFFECTS) for part in _section(name)), _more()]) + '\n'


def _opening() -> Iterator[str]:
    yield '# Physical effects'
    yield (
        "The effects that the [paper's model](../explanation/model.md) lacks, by their textbook names. Each effect has "
        "its own switch; without effects the model is the paper's. Written by `make effects-document` from "
        '`cfd_pneumatic/model/effects`. [add_an_effect.md](../how_to/add_an_effect.md) shows how to add an effect. '
        'Pressures are absolute. A prime marks a quantity that an effect has changed. An arrow marks an update of a '
        'state from step to step:'
    )
    yield SYMBOLS
    yield (
        'The pictures show the virtual rig with one effect. The rig follows a surface, and the set-point steps '
        'occasionally. *Healthy model*, blue: measured minus simulated by the model that was identified without the '
        'effect, as `monitor_node` computes the residual. *Fitted again*, orange: the residual after the four gains '
        'were fitted to the recording with the effect, as in `identify_bag`. If the orange residual is much smaller, '
        'the gains compensate for the effect; only faster motion can show it. Noise alone has a standard deviation of '
        f'{Sensors.pressure_noise:.0f} Pa and {Sensors.force_noise:g} N. Outliers are not plotted on the right.'
    )
    rows = [
        [f'[`{name}`](#{name})', effect.description, _place(name), effect.seen_against]
        for name, effect in sorted(EFFECTS.items())
    ]
    yield table(['effect', 'description', 'acts on', 'visible against'], rows)


def _place(name: str) -> str:
    """Return the quantities that an effect changes."""
    places = [text.split(';')[0] for function, text in FUNCTIONS.items() if hasattr(MODULES[name], function)]
    return '; '.join(places) or TIMES[EFFECTS[name].late]


def _section(name: str) -> Iterator[str]:
    effect = EFFECTS[name]
    yield f'## {name}'
    description, path = effect.description, MODULES[name].__name__.replace('.', '/')
    yield f'{description[0].upper()}{description[1:]}. ([code](../../{path}.py))'
    yield '```math\n' + _latex(effect) + '\n```'
    rows = []
    for parameter in effect.parameters:
        scale = 'logarithmic' if parameter.logarithmic else 'linear'
        limits = f'{parameter.lower:g} to {parameter.upper:g}'
        searched = 'no: starting values only' if parameter.choice else scale
        rows.append(
            [code(parameter.name), parameter.unit, parameter.description, limits, f'{parameter.null:g}', searched]
        )
    yield table(['parameter', 'unit', 'meaning', 'range', 'off at', 'searched'], rows)
    similar = dict.fromkeys(member for family in effect.families for member in FAMILIES[family] if member != name)
    links = (
        ', '.join(f'[`{member}`](#{member})' for member in similar) or 'no effect, if the recording has enough motion'
    )
    yield f'- Acts on: {_place(name)}\n- To show the effect, record: {effect.advice}\n- May be mistaken for: {links}'
    if name in ON_RIG:
        yield f'![How {name} shows]({PICTURES.name}/{name}.svg)'
        installed = ON_RIG[name]
        unit = '' if installed.unit == '1' else f' {installed.unit}'
        yield f'*On the rig: {installed.meaning} {float(f"{_strength(name):.2g}"):g}{unit}.*'
    else:
        yield '*The rig has no such effect.*'


def _latex(effect: Effect) -> str:
    """Return the equations of an effect, one per line, with the parameters' names in italic text."""
    names = '|'.join(re.escape(parameter.name) for parameter in effect.parameters)

    def word(match: re.Match[str]) -> str:
        return r'\mathit{' + match[0].replace('_', r'\_') + '}'

    lines = [re.sub(rf'(?<![\\\w])({names})(?!\w)', word, line) for line in effect.equations]
    return lines[0] if len(lines) == 1 else '\\begin{gathered}\n' + ' \\\\\n'.join(lines) + '\n\\end{gathered}'


def _more() -> str:
    return (
        '## Measurements of the effects\n\n'
        '[effects_panel.md](../measurements/effects_panel.md) reports how often each effect is named, and the '
        'effects that are named instead. [planning.md](../measurements/planning.md) reports which strengths a '
        'planned experiment shows.'
    )


# pictures


class EffectSignals(NamedTuple):
    """Residuals of an effect, and the signals to plot them against, at samples of the rig."""

    residual: Array
    """Measured minus simulated by the model of the healthy device [Pa or N]."""

    refitted: Array | None
    """Measured minus simulated by the refitted model [Pa]; None for the force."""

    signals: dict[str, Array]
    """Signals other than the motion that the residual may be plotted against, in SI units."""


AXES = {
    'time': ('time [s]', 1.0),
    'frequency': ('frequency [Hz]', 1.0),
    'displacement': ('displacement [mm]', 1e-3),
    'speed': ('speed [mm/s]', 1e-3),
    'acceleration': ('acceleration [m/s²]', 1.0),
    'pressure': ('gauge pressure [kPa]', 1e3),
    'pressure rate': ('pressure rate [kPa/s]', 1e3),
    'valve error': ('set-point less pressure [kPa]', 1e3),
}
"""Axis label, and the label's unit in SI, of each signal to plot against."""

TIMES = {'reading': 'time at which the pressure is read [s]', 'setpoint': 'time at which the set-point acts [s]'}
"""Time that a delay without a function changes, by the late signal."""

STYLE = {
    'svg.fonttype': 'none',
    'font.size': 8.0,
    'lines.linewidth': 0.9,
    'lines.markersize': 1.8,
    'axes.grid': True,
    'grid.color': '0.92',
    'axes.spines.top': False,
    'axes.spines.right': False,
}


def _strength(name: str) -> float:
    effect = ON_RIG[name]
    return float(effect.weakest ** (1.0 - STRENGTH) * effect.strongest**STRENGTH)


def _in_pressure(drawn: Draw, healthy: ChannelResult) -> EffectSignals:
    result = _identified(drawn)
    (experiment,) = result.experiments
    (expected,) = healthy.channel.simulated([experiment], healthy.fit.model)
    (level,) = healthy.channel.levels([experiment], healthy.fit.model)
    signals = {
        'pressure': expected - AMBIENT_PRESSURE,
        'pressure rate': np.gradient(expected, experiment.sample_times),
        'valve error': level + AMBIENT_PRESSURE - expected,
    }
    return EffectSignals(experiment.measured - expected, experiment.measured - result.fit.simulated[0], signals)


def _in_force(drawn: Draw) -> EffectSignals:
    pressures = drawn.recording.pressures
    residual = drawn.recording.force - Cylinder().area * (pressures[:, 0] - pressures[:, 1])
    return EffectSignals(residual, None, {'pressure': pressures[:, 0] - AMBIENT_PRESSURE})


def _identified(drawn: Draw) -> ChannelResult:
    return identify([cylinder_a_of(drawn)], Options()).channels[CYLINDER]


def picture(name: str, healthy: ChannelResult) -> str:
    """Plot displacement and residual over time, and the residual against the signal it depends on, as SVG."""
    drawn = draw(name, SCHEDULE, SEED, given={name: _strength(name)})
    seen = _in_force(drawn) if name in FORCE_EFFECTS else _in_pressure(drawn, healthy)
    times = drawn.recording.times
    part = times <= SHOWN
    with matplotlib.rc_context(STYLE | {'svg.hashsalt': name}):
        figure = Figure(figsize=(9.0, 2.3), layout='constrained', dpi=120)
        motion_axes, time_axes, dependence_axes = figure.subplots(1, 3)
        motion_axes.set(xlabel='time [s]', ylabel='displacement [mm]')
        motion_axes.plot(times[part], 1e3 * drawn.recording.displacement[part], '0.3')
        time_axes.set(xlabel='time [s]', ylabel=f'residual [{"N" if name in FORCE_EFFECTS else "Pa"}]')
        time_axes.plot(times[part], seen.residual[part], HEALTHY, label='healthy model')
        if seen.refitted is not None:
            time_axes.plot(times[part], seen.refitted[part], REFITTED, linewidth=0.7, label='fitted again')
            time_axes.legend(loc='lower center', bbox_to_anchor=(0.5, 0.98), ncol=2, frameon=False)
        dependence_axes.set(xlabel=AXES[EFFECTS[name].seen_against][0], ylabel=time_axes.get_ylabel())
        _plot_dependence(dependence_axes, name, drawn, seen)
        for line in (*time_axes.lines, *dependence_axes.lines):
            line.set_rasterized(True)  # thousands of points, as pixels
        stream = io.StringIO()
        figure.savefig(stream, format='svg', metadata={'Date': None})
    return stream.getvalue()


def _plot_dependence(axes: Axes, name: str, drawn: Draw, seen: EffectSignals) -> None:
    times, truth = drawn.recording.times, drawn.truth.samples
    against = EFFECTS[name].seen_against
    if against == 'frequency':
        frequencies, power = periodogram(seen.residual, 1.0 / (times[1] - times[0]), 'hann', scaling='spectrum')
        # the mean and its leakage are not spectral lines
        axes.semilogx(frequencies[2:], np.sqrt(2.0 * power[2:]), HEALTHY)
        axes.set(ylabel=axes.get_ylabel().replace('residual', 'amplitude'))
        return
    motion = {
        'time': times,
        'displacement': truth.displacement,
        'speed': truth.velocity,
        'acceleration': truth.acceleration,
    }
    x = (motion | seen.signals)[against][::EVERY] / AXES[against][1]
    y = seen.residual[::EVERY]
    shown = _within(x) & _within(y)
    axes.plot(x[shown], y[shown], '.', color=HEALTHY)


def _within(values: Array) -> NDArray[np.bool_]:
    """Return which values are not outliers: a step of the set-point would dominate the scale."""
    low, high = np.quantile(values, [0.01, 0.99])
    return np.abs(values - 0.5 * (low + high)) <= 0.75 * (high - low)


def main() -> None:
    """Write the document and its pictures."""
    write_text(DOCUMENT, document())
    healthy = _identified(draw(None, SCHEDULE, SEED))
    for name in sorted(ON_RIG.keys() & EFFECTS.keys()):
        path = PICTURES / f'{name}.svg'
        write_text(path, picture(name, healthy))
        print(path)


if __name__ == '__main__':
    main()
