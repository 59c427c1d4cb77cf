"""
Measure the watch: false alarms and delays against the mean time between false alarms that is asked for.

    make monitor-figures                        # all of it: an hour; writes docs/monitor.md and docs/monitor.svg
    make monitor-figures ARGS='delays document' # some parts; the others' results are taken from the folder --results
    make monitor-figures ARGS='drawn --quick'   # a taste of a part, printed

False alarms are counted over residuals that are drawn as the rig's sensors make them, in which the model cancels, and
over hours of the rig itself beside its identified model. Delays are those of the rig with something that goes wrong.
Blocks, whitening and charts are the watch's own throughout. Seeds below 1000 were for developing, those from 1000 on
are for what is reported.
"""

from __future__ import annotations

import argparse
import io
import itertools
import json
import sys
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import replace
from operator import itemgetter
from pathlib import Path
from typing import NamedTuple

import matplotlib
import numpy as np
from matplotlib.figure import Figure
from scipy.signal import lfilter
from scipy.stats import chi2

sys.path.insert(0, str(Path(__file__).parent))

from cfd_pneumatic.convention import CONTACT_FORCE, CYLINDERS
from cfd_pneumatic.device.identified import identified_device
from cfd_pneumatic.files import write_text
from cfd_pneumatic.identification import Options, identify
from cfd_pneumatic.model import DIRECTIONS, DeviceModel
from cfd_pneumatic.monitoring import Finding, WatchedSignal, diagnose, news
from cfd_pneumatic.monitoring.chart import Chart
from cfd_pneumatic.monitoring.watched_signal import ResidualBlock
from cfd_pneumatic.recording import recording_of
from cfd_pneumatic.rig import Performance, RigParameters, RigRecord, Sensors, record, surface_following, with_changes
from cfd_pneumatic.rig.panel.specimen import draw_specimen
from studies.documents import notes_in, table
from studies.provenance import ROOT, commit, machine
from studies.rig_runs import EPOCH, surfaces

RATE = 500  # samples in a second
BLOCK = 0.2  # [s]
SAMPLES = round(RATE * BLOCK)  # in a block
LEARNING = 300.0  # [s]
INTERVALS = {'10 minutes': 600.0, '1 hour': 3600.0, '1 day': 86_400.0}
"""Mean times between false alarms that are asked for [s]."""

CHANNELS = (*CYLINDERS, CONTACT_FORCE)
FIRST_SEED = 1000
SETTLING = 1.0  # of the model [s]
PIECE = 3600.0  # residuals that are drawn at a time [s]
STRETCH = 600.0  # of a rig that is recorded at a time [s]
WATCH = 6 * 3600.0  # after one learning [s]
DOCUMENT = Path(__file__).parents[1] / 'docs' / 'monitor.md'
PICTURE = DOCUMENT.with_suffix('.svg')

Draw = Callable[[np.random.Generator, int], np.ndarray]


class Count(NamedTuple):
    """False alarms in a time of watching."""

    alarms: int
    seconds: float

    def interval(self) -> tuple[float, float]:
        """Return the exact 95 % interval of the mean time between false alarms [s] (Garwood, 1936)."""
        most = 0.5 * chi2.ppf(0.975, 2 * self.alarms + 2)
        least = 0.5 * chi2.ppf(0.025, 2 * self.alarms) if self.alarms else 0.0
        return self.seconds / most, self.seconds / least if least else np.inf


# false alarms over drawn residuals


def white(rng: np.random.Generator, count: int) -> np.ndarray:
    """Return what a pressure sensor makes of a pressure: white noise and the converter's rounding [Pa]."""
    sensors = Sensors()
    level = sensors.pressure_range[0] + 7e4 + rng.uniform(0.0, sensors.step(sensors.pressure_range))
    return sensors.measure_pressure(np.full(count, level), rng) - level


def coloured(rng: np.random.Generator, count: int) -> np.ndarray:
    """Return noise of the same size through a sensor's filter, as the panel's coloured sensors have it [Pa]."""
    memory = 0.9
    drawn = rng.standard_normal(count + 100) * Sensors().pressure_noise * np.sqrt(1.0 - memory**2)
    return lfilter([1.0], [1.0, -memory], drawn)[100:]


def watchers(blocks: Iterator[ResidualBlock], name: str, channels: int) -> dict[str, WatchedSignal]:
    """Return a channel for each interval, which has learned what is usual from the first blocks."""
    learning, length = round(LEARNING / BLOCK), round(BLOCK * 1e9)
    found = {
        label: WatchedSignal(name, learning, length, channels * interval / BLOCK)
        for label, interval in INTERVALS.items()
    }
    for block, channel in itertools.product(itertools.islice(blocks, learning), found.values()):
        channel.take_block(block)
    return found


def blocks_of(residuals: np.ndarray, rates: np.ndarray) -> Iterator[ResidualBlock]:
    """Yield residuals in blocks."""
    for number in range(residuals.size // SAMPLES):
        own = slice(number * SAMPLES, (number + 1) * SAMPLES)
        yield ResidualBlock(EPOCH + round(number * BLOCK * 1e9), residuals[own], rates[own])


def alarms_of(found: dict[str, WatchedSignal], residuals: np.ndarray, rates: np.ndarray) -> dict[str, int]:
    """Return how often charts ring over blocks, whose features are the same at each interval."""
    baseline = next(iter(found.values())).baseline
    assert baseline is not None  # it has learned
    weighing = baseline.weighing
    innovations = weighing.innovations(weighing.weighed(residuals, rates), np.empty(0))
    features = weighing.features(innovations.reshape(-1, SAMPLES))
    return {label: sum(map(rings, channel.charts, features)) for label, channel in found.items()}


def rings(chart: Chart, values: np.ndarray) -> int:
    """Return how often a chart rings."""
    alarms = 0
    while (at := chart.take(values)) >= 0:
        alarms += 1
        chart.again()
        values = values[at + 1 :]
    return alarms


def drawn_alarms(draw: Draw, runs: int, seconds: float) -> dict[str, Count]:
    """Return the false alarms over drawn residuals, for each interval; a run learns anew."""
    alarms: Counter[str] = Counter()
    for seed in range(FIRST_SEED, FIRST_SEED + runs):
        for name, child in zip(CHANNELS, np.random.SeedSequence(seed).spawn(len(CHANNELS))):
            rng = np.random.default_rng(child)
            learned = draw(rng, round((LEARNING + 1.0) * RATE))
            found = watchers(blocks_of(learned, np.zeros_like(learned)), name, len(CHANNELS))
            for _ in range(round(seconds / PIECE)):
                residuals = draw(rng, round(PIECE * RATE))
                alarms.update(alarms_of(found, residuals, np.zeros_like(residuals)))
    return {label: Count(alarms[label], runs * seconds) for label in INTERVALS}


# the rig beside its model


def residuals_of(device: DeviceModel, got: RigRecord) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Return residuals and rates of each cylinder, as the live model makes them, from when it has settled."""
    found = {}
    begin = round(SETTLING * RATE)
    for index, (name, cylinder) in enumerate(zip(CYLINDERS, (device.a, device.b))):
        assert cylinder is not None
        predicted = cylinder.simulate(got.times, DIRECTIONS[name] * got.displacement, got.setpoints[:, index])
        rates = np.diff(predicted, prepend=predicted[:1]) / np.diff(got.times, prepend=got.times[0] - 1.0)
        found[name] = (got.pressures[:, index] - predicted)[begin:], rates[begin:]
    return found


class Healthy(NamedTuple):
    """A rig and the model that was identified from a minute of it."""

    rig: RigParameters
    device: DeviceModel
    seed: int

    def performance(self, duration: float) -> Performance:
        """Return it at the beginning of a random surface of a duration [s]."""
        return surfaces(self.rig, self.seed + 500_000, duration)


def healthy(seed: int, frozen: bool = True) -> Healthy:
    """Return a rig and its model, identified: one drawn at random that is as the paper's, or the rig as it is."""
    rig = draw_specimen(np.random.default_rng(seed))[0].rig if frozen else RigParameters()
    got = record(surface_following(duration=60.0, seed=seed), rig, seed=seed)
    return Healthy(rig, identified_device(identify([recording_of(got)])).model, seed)


def rig_alarms(frozen: bool, runs: int, stretches: int) -> dict[str, Count]:
    """Return the false alarms on rigs beside their models, for each interval."""
    alarms: Counter[str] = Counter()
    for seed in range(FIRST_SEED, FIRST_SEED + runs):
        one = healthy(seed, frozen)
        performance = one.performance(3000.0)
        learned = residuals_of(one.device, performance.take(round((LEARNING + 3.0) * RATE)))
        found = {name: watchers(blocks_of(*own), name, len(CYLINDERS)) for name, own in learned.items()}
        for _ in range(stretches):
            got = performance.take(round(STRETCH * RATE))
            for name, own in residuals_of(one.device, got).items():
                alarms.update(alarms_of(found[name], *own))
    return {label: Count(alarms[label], runs * stretches * (STRETCH - SETTLING)) for label in INTERVALS}


# delays


class Trouble(NamedTuple):
    """Something that goes wrong with cylinder A."""

    title: str
    effect: str
    """That the loop ought to name."""
    field: str
    """Of the rig's effects."""
    unit: str
    sizes: tuple[float, ...]
    growth: float
    """How long it takes to reach its size [s]."""


TROUBLES = (
    Trouble('leak that grows for 60 s', 'leakage', 'leak_conductance', 'm³/(s Pa)', (1e-12, 1e-11, 1e-10), 60.0),
    Trouble('dead band that appears', 'valve_dead_band', 'dead_band', 'Pa', (5.0, 20.0, 100.0), 0.0),
    Trouble('sensor that lags', 'sensor_lag', 'sensor_lag', 's', (5e-5, 2e-4, 1e-3), 0.0),
)
PATIENCE = 125.0  # that a trouble is waited for [s]
WINDOW = 60.0  # of a diagnosis [s]
BEGINS = LEARNING + SETTLING + WINDOW  # when a trouble does [s]
PLAYED = 1200.0  # duration of the surface [s]


def play(one: Healthy, trouble: Trouble, size: float) -> RigRecord:
    """Return a record in which a trouble begins, and grows from second to second."""
    performance = one.performance(PLAYED)
    records = [performance.take(round(BEGINS * RATE))]
    for second in range(round(PATIENCE)):
        share = min((second + 1.0) / trouble.growth, 1.0) if trouble.growth else 1.0
        performance.change(with_changes(one.rig, {f'effects_a.{trouble.field}': share * size}))
        records.append(performance.take(RATE))
    names = ('times', 'displacement', 'pressures', 'setpoints', 'force')
    together = {name: np.concatenate([getattr(part, name) for part in records]) for name in names}
    return RigRecord(**together, truth=records[0].truth)


def delays_in(one: Healthy, got: RigRecord) -> dict[str, float]:
    """Return how late a trouble is noticed for each interval, infinite where it is not [s]."""
    delays = dict.fromkeys(INTERVALS, np.inf)
    for name, own in residuals_of(one.device, got).items():
        blocks = blocks_of(*own)
        channels = watchers(blocks, name, len(CYLINDERS))
        for number, block in enumerate(blocks, round(LEARNING / BLOCK) + 1):
            late = SETTLING + number * BLOCK - BEGINS
            for label, channel in channels.items():
                if channel.take_block(block) is not None and late > 0.0:
                    delays[label] = min(delays[label], late)
    return delays


def found_in(got: RigRecord, begin: float) -> Finding:
    """Close the loop on the pressures of a window."""
    window = recording_of(got).between(begin, begin + WINDOW)
    return diagnose(replace(window, force=None), Options(close_loop=True))


def named(trouble: Trouble, before: Finding, after: Finding) -> str:
    """Return whether the loop names the trouble as what is new."""
    told = news(after.found['cylinder_a'], before.found.get('cylinder_a'))
    if trouble.effect in told.effects:
        return 'right'
    if any(trouble.effect in others for others in told.effects.values()):
        return 'listed'
    return 'other' if told.effects else 'nothing'


# the parts, and the document


def part_drawn(quick: bool) -> dict:
    """Count false alarms over drawn residuals."""
    runs, seconds = (4, 2 * PIECE) if quick else (120, WATCH)
    return {f'{draw.__name__} noise, drawn': drawn_alarms(draw, runs, seconds) for draw in (white, coloured)}


def part_rig(quick: bool) -> dict:
    """Count false alarms over hours of rigs."""
    runs, stretches = (1, 2) if quick else (12, 6)
    return {
        'rig as the paper’s device, beside its model': rig_alarms(True, runs, stretches),
        'rig as it is, its model without effects': rig_alarms(False, runs, stretches),
    }


def part_delays(quick: bool) -> list:
    """Measure delays on some rigs, and ask what the loop names on the first of them."""
    rigs = [healthy(seed) for seed in range(FIRST_SEED, FIRST_SEED + (1 if quick else 4))]
    before = None if quick else found_in(rigs[0].performance(PLAYED).take(round(BEGINS * RATE)), SETTLING)
    rows = []
    for trouble in TROUBLES:
        for size in trouble.sizes:
            records = [play(one, trouble, size) for one in rigs]
            delays = [delays_in(one, got) for one, got in zip(rigs, records)]
            told = 'not asked' if quick else 'nothing'
            if before is not None and np.isfinite(delays[0]['1 day']):
                told = named(trouble, before, found_in(records[0], BEGINS + trouble.growth + 1.0))
            rows.append({**trouble._asdict(), 'size': size, 'delays': delays, 'named': told})
            print(rows[-1], flush=True)
    return rows


PARTS = {'drawn': part_drawn, 'rig': part_rig, 'delays': part_delays}


def duration(seconds: float) -> str:
    """Return a time as people say it."""
    for unit, size in (('d', 86_400.0), ('h', 3600.0), ('min', 60.0)):
        if seconds >= size:
            return f'{seconds / size:.3g} {unit}'
    return f'{seconds:.3g} s'


def false_alarm_section(results: dict) -> str:
    """Return the table of false alarms."""
    counts = {**results.get('drawn', {}), **results.get('rig', {})}
    lines = []
    for title, asked in itertools.product(counts, INTERVALS):
        count = Count(*counts[title][asked])
        low, high = count.interval()
        interval = f'{duration(low)} to {duration(high) if np.isfinite(high) else "any"}'
        mean = duration(count.seconds / count.alarms) if count.alarms else 'none'
        expected = f'{count.seconds / INTERVALS[asked]:.3g}'
        lines.append([title, duration(count.seconds), asked, expected, count.alarms, mean, interval])
    heading = ['residual', 'watched', 'asked for', 'expected', 'false alarms', 'mean time between', '95 % interval']
    return table(heading, lines)


def delay_section(rows: list[dict]) -> str:
    """Return the table of delays."""
    lines = []
    for row in rows:
        delays = [median_and_range([one[asked] for one in row['delays']]) for asked in INTERVALS]
        lines.append([row['title'], f'{row["size"]:g} {row["unit"]}', *delays, len(row['delays']), row['named']])
    asked = [f'asked for: {asked}' for asked in INTERVALS]
    return table(['what goes wrong', 'size', *asked, 'rigs', 'what the loop names'], lines)


def median_and_range(delays: list[float]) -> str:
    """Return median and range of delays [s]."""
    met = [one for one in delays if np.isfinite(one)]
    if not met:
        return 'not met'
    missed = f', {len(delays) - len(met)} not met' if len(met) < len(delays) else ''
    return f'{np.median(met):.1f} s ({min(met):.1f} to {max(met):.1f}{missed})'


def picture(rows: list[dict]) -> str:
    """Return delays against size, as SVG."""
    with matplotlib.rc_context({'svg.hashsalt': 'monitor', 'svg.fonttype': 'none', 'font.size': 8.0}):
        figure = Figure(figsize=(6.0, 3.4), layout='constrained')
        axes = figure.subplots()
        for title, some in itertools.groupby(rows, itemgetter('title')):
            own = list(some)
            sizes = np.array([row['size'] for row in own])
            delays = np.array([[one['1 day'] for one in row['delays']] for row in own])
            label = f'{title}; 1 is {sizes[0]:g} {own[0]["unit"]}'
            (line,) = axes.loglog(sizes / sizes[0], np.median(delays, axis=1), linewidth=1.0, label=label)
            axes.loglog(sizes / sizes[0], delays, 'o', ms=3, color=line.get_color())
        axes.set(xlabel='size over the smallest', ylabel='delay [s]', title='Delays at one false alarm a day')
        axes.set_ylim(top=20.0 * PATIENCE)  # leaves room for the legend
        axes.legend(loc='upper right')
        stream = io.StringIO()
        figure.savefig(stream, format='svg', metadata={'Date': None})
    return stream.getvalue()


def document(results: dict) -> str:
    """Return docs/monitor.md."""
    parts = [
        '# What the watch notices, and how often it is wrong',
        f'Command: `make monitor-figures`. Machine: {machine()}. Commit {commit()}.',
        f'Everything at {RATE} Hz: blocks of {BLOCK:g} s, {LEARNING:g} s of learning, two cylinders and the force '
        '(drawn) or two cylinders (rig). Thresholds and whitening were developed on seeds below 1000; these are seeds '
        f'from {FIRST_SEED} on.',
        '## False alarms',
        'Noise is drawn as the rig’s pressure sensor makes it (white, 12 bits), and with a memory of 0.9 from sample '
        f'to sample. Each noise is watched 120 times {WATCH / 3600.0:g} hours, each after a learning of its own; '
        'intervals are exact for a Poisson count (Garwood, 1936). The rig follows random surfaces while its set-points '
        'step every 1 to 4 s; its model was identified from another minute.',
        false_alarm_section(results),
        '## Delays',
        'Cylinder A of rigs drawn at random, following a surface. Median and range over rigs; what the loop names is '
        f'what `identify_bag --close-loop` finds in {WINDOW:g} s behind the change against {WINDOW:g} s before it, in '
        f'the first rig. *Not met* is not within {PATIENCE:g} s; *listed* is as an alternative that can’t be told '
        'apart.',
        delay_section(results['delays']),
        '![Delays](monitor.svg)',
        notes_in(DOCUMENT),
    ]
    return '\n\n'.join(parts).rstrip() + '\n'


def main() -> None:
    """Measure what is asked for, and write the document."""
    parser = argparse.ArgumentParser(description='Measure the watch: false alarms and delays.')
    parser.add_argument('parts', nargs='*', help=f'{", ".join(PARTS)}, document; none: all')
    parser.add_argument('--quick', action='store_true', help='a taste of each part, printed only')
    parser.add_argument('--results', type=Path, default=ROOT / 'build' / 'monitor_figures', help='folder of the parts')
    arguments = parser.parse_args()
    chosen = arguments.parts or [*PARTS, 'document']
    arguments.results.mkdir(parents=True, exist_ok=True)
    for name in chosen:
        if name != 'document':
            found = json.dumps({'result': PARTS[name](arguments.quick)})
            print(found, flush=True)
            if not arguments.quick:
                write_text(arguments.results / f'{name}.json', found)
    if 'document' in chosen and not arguments.quick:
        results = {file.stem: json.loads(file.read_text())['result'] for file in arguments.results.glob('*.json')}
        write_text(DOCUMENT, document(results))
        write_text(PICTURE, picture(results['delays']))


if __name__ == '__main__':
    main()
