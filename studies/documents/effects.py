# SPDX-License-Identifier: Apache-2.0
"""
Every physical effect, and how it shows: make effects-document writes docs/effects.md and docs/effects/*.svg.

What is written comes from the effects' own files. The pictures come from the virtual rig, which has physics of its own:
a device with the effect in it, less the model of the device without.
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

DOCUMENT = ROOT / 'docs' / 'effects.md'
PICTURES = ROOT / 'docs' / 'effects'

CYLINDER = 'cylinder_a'
SEED = 9
"""Of a device whose seal lifts both ways, and whose pressures come late rather than early."""

SCHEDULE = surface_following(9.0 * PSI, 1.8e-3, setpoint_steps=3.0 * PSI, bandwidth=6.0, duration=24.0, seed=1)
SHOWN = 5.0
"""How much of it is drawn over time [s]."""

STRENGTH = 0.75
"""Where between its weakest and its strongest an effect is drawn, on a logarithmic scale."""

EVERY = 20
"""Of so many samples one is a dot."""

HEALTHY, REFITTED = '#1f77b4', '#ff7f0e'

SYMBOLS = r"""
| symbol | meaning |
| --- | --- |
| $x$ | measured displacement; it grows the chamber |
| $p$ | pressure in the cylinder |
| $p_f$ | pressure that the regulator senses; $p_r$ at its outlet |
| $p_d$ | set-point |
| $p_0$ | ambient pressure |
| $e$ | valve error, $p_d - p_f$ |
| $q$ | pressure rate that the valve's flow makes, $K\,e$ |
| $s$ | pressure that the sensor reads |
| $F$ | contact force |
| $\psi(r)$ | flow function of ISO 6358: 1 up to $r = 0.528$, then $\sqrt{1 - ((r - 0.528) / 0.472)^2}$ |
""".strip()


# what is written


def document() -> str:
    """Return the document in Markdown; it needs no simulation."""
    return '\n\n'.join([*_opening(), *(part for name in sorted(EFFECTS) for part in _section(name)), _more()]) + '\n'


def _opening() -> Iterator[str]:
    yield '# Physical effects'
    yield (
        "What the paper's model lacks, by its standard names. Each effect is switched on by itself; where it is off, "
        "the model is the [paper's](model.md). Written by `make effects-document` from `cfd_pneumatic/model/effects`; "
        '[adding_an_effect.md](adding_an_effect.md) shows how to add one. Pressures are absolute. A stroke marks what '
        'an effect has changed, and an arrow what remains from step to step:'
    )
    yield SYMBOLS
    yield (
        'The pictures show the virtual rig as it follows a surface, with a step of the set-point now and then and one '
        'effect in it. *Healthy model*, blue: measured less the model that was identified without the effect, as '
        '`monitor_node` sees it. *Fitted again*, orange: what is left when the four gains have been fitted to the '
        'recording with the effect, as `identify_bag` sees it; where it is much smaller, they have taken the effect '
        'up, and livelier motion has to show it. Noise alone has a standard deviation of '
        f'{Sensors.pressure_noise:.0f} Pa, and of {Sensors.force_noise:g} N. On the right, what sticks out is left '
        'away.'
    )
    rows = [
        [f'[`{name}`](#{name})', effect.description, _place(name), effect.seen_against]
        for name, effect in sorted(EFFECTS.items())
    ]
    yield table(['effect', 'what it is', 'acts on', 'shows against'], rows)


def _place(name: str) -> str:
    """Return what an effect changes."""
    found = [words.split(';')[0] for function, words in FUNCTIONS.items() if hasattr(MODULES[name], function)]
    return '; '.join(found) or 'time at which the pressure is read [s]'


def _section(name: str) -> Iterator[str]:
    effect = EFFECTS[name]
    yield f'## {name}'
    said, path = effect.description, MODULES[name].__name__.replace('.', '/')
    yield f'{said[0].upper()}{said[1:]}. ([code](../{path}.py))'
    yield '```math\n' + _latex(effect) + '\n```'
    rows = []
    for one in effect.parameters:
        searched = 'no: starting values only' if one.choice else 'in its logarithm' if one.logarithmic else 'as it is'
        rows.append(
            [code(one.name), one.unit, one.description, f'{one.lower:g} to {one.upper:g}', f'{one.null:g}', searched]
        )
    yield table(['parameter', 'unit', 'meaning', 'range', 'off at', 'searched'], rows)
    others = dict.fromkeys(other for family in effect.families for other in FAMILIES[family] if other != name)
    taken = ', '.join(f'[`{other}`](#{other})' for other in others) or 'none of these, where the recording is lively'
    yield f'- Acts on: {_place(name)}\n- To see it, record: {effect.advice}\n- May be taken for: {taken}'
    if name in ON_RIG:
        yield f'![How {name} shows]({PICTURES.name}/{name}.svg)'
        installed = ON_RIG[name]
        unit = '' if installed.unit == '1' else f' {installed.unit}'
        yield f'*On the rig: {installed.meaning} {float(f"{_strength(name):.2g}"):g}{unit}.*'
    else:
        yield '*The rig has no such effect.*'


def _latex(effect: Effect) -> str:
    """Return its equations, one below the other, with its parameters' names set as words."""
    names = '|'.join(re.escape(one.name) for one in effect.parameters)

    def word(found: re.Match[str]) -> str:
        return r'\mathit{' + found[0].replace('_', r'\_') + '}'

    lines = [re.sub(rf'(?<![\\\w])({names})(?!\w)', word, line) for line in effect.equations]
    return lines[0] if len(lines) == 1 else '\\begin{gathered}\n' + ' \\\\\n'.join(lines) + '\n\\end{gathered}'


def _more() -> str:
    return (
        '## What else is known of them\n\n'
        'How often each is named, and for which it is taken, is measured in [effects_panel.md](effects_panel.md); what '
        'a planned experiment would show in [planning.md](planning.md).'
    )


# what is drawn


class Seen(NamedTuple):
    """How an effect shows, at samples of the rig."""

    residual: Array
    """By the model of the healthy device [Pa or N]."""

    refitted: Array | None
    signals: dict[str, Array]
    """What it may be seen against beside the motion, in SI units."""


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
"""Label, and the unit in SI, of what an effect may be seen against."""

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


def _in_pressure(drawn: Draw, healthy: ChannelResult) -> Seen:
    found = _identified(drawn)
    (experiment,) = found.experiments
    (expected,) = healthy.channel.simulated([experiment], healthy.fit.model)
    (level,) = healthy.channel.levels([experiment], healthy.fit.model)
    signals = {
        'pressure': expected - AMBIENT_PRESSURE,
        'pressure rate': np.gradient(expected, experiment.sample_times),
        'valve error': level + AMBIENT_PRESSURE - expected,
    }
    return Seen(experiment.measured - expected, experiment.measured - found.fit.simulated[0], signals)


def _in_force(drawn: Draw) -> Seen:
    pressures = drawn.recording.pressures
    residual = drawn.recording.force - Cylinder().area * (pressures[:, 0] - pressures[:, 1])
    return Seen(residual, None, {'pressure': pressures[:, 0] - AMBIENT_PRESSURE})


def _identified(drawn: Draw) -> ChannelResult:
    return identify([cylinder_a_of(drawn)], Options()).channels[CYLINDER]


def picture(name: str, healthy: ChannelResult) -> str:
    """Return displacement, residual over time, and residual against what tells it, as SVG."""
    drawn = draw(name, SCHEDULE, SEED, given={name: _strength(name)})
    seen = _in_force(drawn) if name in FORCE_EFFECTS else _in_pressure(drawn, healthy)
    times = drawn.recording.times
    part = times <= SHOWN
    with matplotlib.rc_context(STYLE | {'svg.hashsalt': name}):
        figure = Figure(figsize=(9.0, 2.3), layout='constrained', dpi=120)
        moved, over_time, told = figure.subplots(1, 3)
        moved.set(xlabel='time [s]', ylabel='displacement [mm]')
        moved.plot(times[part], 1e3 * drawn.recording.displacement[part], '0.3')
        over_time.set(xlabel='time [s]', ylabel=f'residual [{"N" if name in FORCE_EFFECTS else "Pa"}]')
        over_time.plot(times[part], seen.residual[part], HEALTHY, label='healthy model')
        if seen.refitted is not None:
            over_time.plot(times[part], seen.refitted[part], REFITTED, linewidth=0.7, label='fitted again')
            over_time.legend(loc='lower center', bbox_to_anchor=(0.5, 0.98), ncol=2, frameon=False)
        told.set(xlabel=AXES[EFFECTS[name].seen_against][0], ylabel=over_time.get_ylabel())
        _tell(told, name, drawn, seen)
        for line in (*over_time.lines, *told.lines):
            line.set_rasterized(True)  # thousands of points, as pixels
        stream = io.StringIO()
        figure.savefig(stream, format='svg', metadata={'Date': None})
    return stream.getvalue()


def _tell(axes: Axes, name: str, drawn: Draw, seen: Seen) -> None:
    times, truth = drawn.recording.times, drawn.truth.samples
    against = EFFECTS[name].seen_against
    if against == 'frequency':
        frequencies, power = periodogram(seen.residual, 1.0 / (times[1] - times[0]), 'hann', scaling='spectrum')
        # the mean and what leaks from it are no line
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
    """Return which values are no outliers: a set-point's step would squeeze all else."""
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
