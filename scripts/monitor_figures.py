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
import json
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.signal import lfilter
from scipy.stats import chi2

sys.path.insert(0, str(Path(__file__).parent))

from documents import notes_in, table
from patrol import EPOCH, identified_device, recording_of, surfaces, take
from provenance import ROOT, commit, machine

from cfd_pneumatic.convention import AMBIENT_PRESSURE, CONTACT_FORCE, CYLINDERS
from cfd_pneumatic.files import write_text
from cfd_pneumatic.identification import Options, identify
from cfd_pneumatic.model import DIRECTIONS, Device
from cfd_pneumatic.monitoring import Finding, WatchedSignal, diagnose, news
from cfd_pneumatic.monitoring.watched_signal import ResidualBlock
from cfd_pneumatic.rig import RigParameters, RigRecord, Sensors, record, surface_following, with_changes
from cfd_pneumatic.rig.panel.specimen import draw_specimen

RATE = 500  # samples in a second
BLOCK = 0.2  # [s]
SAMPLES = round(RATE * BLOCK)  # in a block
LEARNING = 300.0  # [s]
INTERVALS = {'10 minutes': 600.0, '1 hour': 3600.0, '1 day': 86_400.0}
"""Mean times between false alarms that are asked for [s]."""

CHANNELS = (*CYLINDERS, CONTACT_FORCE)
FIRST_SEED = 1000
DAY = 86_400.0
PIECE = 3600.0  # residuals that are drawn at a time [s]
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


def watchers(
    blocks: Iterator[ResidualBlock], intervals: dict[str, float], name: str, channels: int
) -> dict[str, WatchedSignal]:
    """Return a channel for each interval; what is usual is learned once, as each of them would."""
    first = WatchedSignal(name, round(LEARNING / BLOCK), round(BLOCK * 1e9), channels * DAY / BLOCK)
    while first.baseline is None:
        first.take_block(next(blocks))
    found = {}
    for label, interval in intervals.items():
        found[label] = WatchedSignal(name, 0, round(BLOCK * 1e9), channels * interval / BLOCK)
        found[label].adopt(first.baseline)
    return found


def blocks_of(residuals: np.ndarray, rates: np.ndarray, start: int = EPOCH) -> Iterator[ResidualBlock]:
    """Yield residuals in blocks."""
    for number in range(residuals.size // SAMPLES):
        own = slice(number * SAMPLES, (number + 1) * SAMPLES)
        yield ResidualBlock(start + round(number * BLOCK * 1e9), residuals[own], rates[own])


def rung(channel: WatchedSignal, features: tuple[np.ndarray, np.ndarray]) -> int:
    """Return how often the charts ring over means and energies of blocks."""
    alarms = 0
    for chart, values in zip(channel.charts, features):
        left = values
        while (at := chart.take(left)) >= 0:
            alarms += 1
            chart.again()
            left = left[at + 1 :]
    return alarms


def features_of(
    found: dict[str, WatchedSignal], residuals: np.ndarray, rates: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return means and energies of blocks; channels that have learned the same have the same."""
    weighing = next(iter(found.values())).baseline.weighing
    innovations = weighing.innovations(weighing.weighed(residuals, rates), np.empty(0))
    return weighing.features(innovations.reshape(-1, SAMPLES))


def drawn_alarms(draw: Draw, runs: int, seconds: float, first_seed: int) -> dict[str, list[int]]:
    """Return the number of false alarms of each run, for each interval; a run learns anew."""
    counts: dict[str, list[int]] = {label: [] for label in INTERVALS}
    for seed in range(first_seed, first_seed + runs):
        totals = dict.fromkeys(INTERVALS, 0)
        for name, child in zip(CHANNELS, np.random.SeedSequence(seed).spawn(len(CHANNELS))):
            rng = np.random.default_rng(child)
            learned = draw(rng, round((LEARNING + 1.0) * RATE))
            found = watchers(blocks_of(learned, np.zeros_like(learned)), INTERVALS, name, len(CHANNELS))
            for _ in range(round(seconds / PIECE)):
                residuals = draw(rng, round(PIECE * RATE))
                features = features_of(found, residuals, np.zeros_like(residuals))
                for label, channel in found.items():
                    totals[label] += rung(channel, features)
        for label, total in totals.items():
            counts[label].append(total)
    return counts


# the rig beside its model


def residuals_of(device: Device, got: RigRecord) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Return residuals and rates of each cylinder, as the live model makes them sample by sample."""
    found = {}
    for index, (name, cylinder) in enumerate(zip(CYLINDERS, (device.a, device.b))):
        predicted = cylinder.simulate(got.times, DIRECTIONS[name] * got.displacement, got.setpoints[:, index])
        rates = np.diff(predicted, prepend=predicted[:1]) / np.diff(got.times, prepend=got.times[0] - 1.0)
        found[name] = got.pressures[:, index] - predicted, rates
    return found


class Healthy(NamedTuple):
    """A rig and the model that was identified from a minute of it."""

    rig: RigParameters
    device: Device


@lru_cache(maxsize=8)
def healthy(seed: int, frozen: bool = True) -> Healthy:
    """Return a rig and its model, identified: one drawn at random that is as the paper's, or the rig as it is."""
    rig = draw_specimen(np.random.default_rng(seed))[0].rig if frozen else RigParameters()
    got = record(surface_following(duration=60.0, seed=seed), rig, seed=seed)
    return Healthy(rig, identified_device(identify([recording_of(got)])))


def rig_alarms(frozen: bool, runs: int, seconds: float, first_seed: int) -> dict[str, Count]:
    """Return the false alarms on rigs beside their models, for each interval."""
    alarms = dict.fromkeys(INTERVALS, 0)
    watched = 0.0
    for seed in range(first_seed, first_seed + runs):
        one = healthy(seed, frozen)
        performance = surfaces(one.rig, seed + 500_000, 3000.0)
        learned = residuals_of(one.device, take(performance, round((LEARNING + 3.0) * RATE)))
        found = {
            name: watchers(blocks_of(residual[RATE:], rate[RATE:]), INTERVALS, name, len(CYLINDERS))
            for name, (residual, rate) in learned.items()
        }
        left = seconds
        while left > 0.0:
            got = take(performance, round(min(left, 600.0) * RATE))
            whole = slice(RATE, RATE + (got.times.size - RATE) // SAMPLES * SAMPLES)  # the model settles first
            for name, (residual, rate) in residuals_of(one.device, got).items():
                features = features_of(found[name], residual[whole], rate[whole])
                for label, channel in found[name].items():
                    alarms[label] += rung(channel, features)
            watched += (whole.stop - whole.start) / RATE
            left -= 600.0
    return {label: Count(count, watched) for label, count in alarms.items()}


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
STEP = 1.0  # in which a trouble grows [s]


class Delay(NamedTuple):
    """When one trouble was noticed, and what it was taken for."""

    seconds: dict[str, float]
    """Delay for each interval, infinite where it was not noticed [s]."""
    named: str | None
    """`right`, `listed`, `other` or `nothing`; None where nobody asked."""


def fields(got: RigRecord) -> dict[str, np.ndarray]:
    """Return what the sensors read."""
    return {name: values for name, values in vars(got).items() if name != 'truth'}


def joined(records: list[RigRecord]) -> RigRecord:
    """Return records that follow each other as one."""
    parts = {name: np.concatenate([fields(one)[name] for one in records]) for name in fields(records[0])}
    return RigRecord(**parts, truth=records[0].truth)


def part(got: RigRecord, begin: float, end: float) -> RigRecord:
    """Return what was read from one time to another [s]."""
    own = slice(round(begin * RATE), round(end * RATE))
    return RigRecord(**{name: values[own] for name, values in fields(got).items()}, truth=got.truth)


BEGINS = LEARNING + 1.0 + WINDOW  # when a trouble does [s]


def play(one: Healthy, trouble: Trouble, size: float, seed: int) -> RigRecord:
    """Return a record in which a trouble begins."""
    performance = surfaces(one.rig, seed + 500_000, 1200.0)
    records = [take(performance, round(BEGINS * RATE))]
    for second in range(round(PATIENCE / STEP)):
        share = min((second + 1) * STEP / trouble.growth, 1.0) if trouble.growth else 1.0
        performance.change(with_changes(one.rig, {f'effects_a.{trouble.field}': share * size}))
        records.append(take(performance, round(STEP * RATE)))
    return joined(records)


def delay_of(trouble: Trouble, size: float, seed: int, name_it: bool) -> Delay:
    """Return when a trouble is noticed and what it is taken for, once it has grown for a whole window."""
    one = healthy(seed)
    got = play(one, trouble, size, seed)
    seconds = dict.fromkeys(INTERVALS, np.inf)
    for name, (residual, rate) in residuals_of(one.device, got).items():
        blocks = list(blocks_of(residual[RATE:], rate[RATE:]))
        for label, channel in watchers(iter(blocks), INTERVALS, name, len(CYLINDERS)).items():
            for number in range(round(LEARNING / BLOCK), len(blocks)):
                late = 1.0 + (number + 1) * BLOCK - BEGINS
                if channel.take_block(blocks[number]) is not None and late > 0.0:
                    seconds[label] = min(seconds[label], late)
                    break
    if not name_it or not np.isfinite(seconds['1 day']):
        return Delay(seconds, 'nothing' if name_it else None)
    grown = BEGINS + trouble.growth + 1.0
    before = usual_findings(seed, part(got, 1.0, 1.0 + WINDOW))
    return Delay(seconds, named(before, part(got, grown, grown + WINDOW), trouble))


FINDINGS: dict[int, Finding] = {}


def found_in(got: RigRecord) -> Finding:
    """Close the loop on the pressures of a record."""
    options = Options(close_loop=True, ambient_pressure=AMBIENT_PRESSURE)
    return diagnose(replace(recording_of(got), force=None), options)


def usual_findings(seed: int, got: RigRecord) -> Finding:
    """Return what the loop makes of the healthy rig of a seed, the same whatever goes wrong with it later."""
    if seed not in FINDINGS:
        FINDINGS[seed] = found_in(got)
    return FINDINGS[seed]


def named(before: Finding, after: RigRecord, trouble: Trouble) -> str:
    """Return whether the loop, closed on a window, names the trouble as what is new."""
    told = news(found_in(after).found['cylinder_a'], before.found.get('cylinder_a'))
    if trouble.effect in told.effects:
        return 'right'
    if any(trouble.effect in others for others in told.effects.values()):
        return 'listed'
    return 'other' if told.effects else 'nothing'


# the parts, and the document


def part_drawn(quick: bool) -> dict:
    """Count false alarms over drawn residuals."""
    runs, seconds = (4, 2 * PIECE) if quick else (120, WATCH)
    return {
        name: {'alarms': drawn_alarms(draw, runs, seconds, FIRST_SEED), 'seconds': runs * seconds, 'runs': runs}
        for name, draw in (('white', white), ('coloured', coloured))
    }


def part_rig(quick: bool) -> dict:
    """Count false alarms over hours of rigs."""
    runs, seconds = (1, 1200.0) if quick else (12, 3600.0)
    return {
        name: rig_alarms(frozen, runs, seconds, FIRST_SEED) for name, frozen in (('drawn', True), ('as it is', False))
    }


def part_delays(quick: bool) -> list:
    """Measure delays."""
    seeds, to_name = (1, 0) if quick else (4, 1)
    rows = []
    for seed in range(FIRST_SEED, FIRST_SEED + seeds):
        for trouble in TROUBLES:
            for size in trouble.sizes:
                delay = delay_of(trouble, size, seed, seed < FIRST_SEED + to_name)
                rows.append({'trouble': trouble.title, 'size': size, 'seed': seed, **delay._asdict()})
                print(rows[-1], flush=True)
    return rows


def part_live(quick: bool) -> dict:
    """Measure, in a graph, how late predictions are while nothing is diagnosed and while the loop is being closed."""
    from monitor_live import latencies  # needs ROS 2

    return latencies(10.0 if quick else 30.0)


PARTS = {'drawn': part_drawn, 'rig': part_rig, 'delays': part_delays, 'live': part_live}


def duration(seconds: float) -> str:
    """Return a time as people say it."""
    for unit, size in (('days', DAY), ('h', 3600.0), ('min', 60.0)):
        if seconds >= size:
            number = f'{seconds / size:.3g}'
            return f'{number} {unit.rstrip("s") if number == "1" else unit}'
    return f'{seconds:.3g} s'


def alarm_row(noise: str, asked: str, count: Count) -> list[str]:
    """Return a row of the table of false alarms."""
    low, high = count.interval()
    expected = count.seconds / INTERVALS[asked]
    mean = duration(count.seconds / count.alarms) if count.alarms else 'none'
    upper = duration(high) if np.isfinite(high) else 'any'
    return [
        noise,
        duration(count.seconds),
        asked,
        f'{expected:.3g}',
        str(count.alarms),
        mean,
        f'{duration(low)} to {upper}',
    ]


def false_alarm_section(results: dict) -> str:
    """Return the tables of false alarms."""
    lines = []
    for noise, found in results.get('drawn', {}).items():
        for asked, alarms in found['alarms'].items():
            lines.append(alarm_row(f'{noise} noise, drawn', asked, Count(sum(alarms), found['seconds'])))
    titles = {
        'drawn': 'rig as the paper’s device, beside its model',
        'as it is': 'rig as it is, its model without effects',
    }
    for kind, counts in results.get('rig', {}).items():
        lines += [alarm_row(titles[kind], asked, Count(*count)) for asked, count in counts.items()]
    heading = ['residual', 'watched', 'asked for', 'expected', 'false alarms', 'mean time between', '95 % interval']
    return table(heading, lines)


def delay_section(rows: list[dict]) -> str:
    """Return the table of delays."""
    lines = []
    for trouble in TROUBLES:
        for size in trouble.sizes:
            own = [row for row in rows if (row['trouble'], row['size']) == (trouble.title, size)]
            told = [row['named'] for row in own if row['named'] is not None]
            if own:
                delays = [delays_of(own, asked) for asked in INTERVALS]
                named = ', '.join(f'{told.count(word)} {word}' for word in dict.fromkeys(told)) or 'not asked'
                lines.append([trouble.title, f'{size:g} {trouble.unit}', *delays, str(len(own)), named])
    heading = [
        'what goes wrong',
        'size',
        *(f'asked for: {asked}' for asked in INTERVALS),
        'rigs',
        'what the loop names',
    ]
    return table(heading, lines)


def delays_of(rows: list[dict], asked: str) -> str:
    """Return median and range of delays."""
    seconds = sorted(row['seconds'][asked] for row in rows)
    met = [one for one in seconds if np.isfinite(one)]
    if not met:
        return 'not met'
    missed = f', {len(seconds) - len(met)} not met' if len(met) < len(seconds) else ''
    return f'{np.median(met):.1f} s ({met[0]:.1f} to {met[-1]:.1f}{missed})'


def picture(results: dict) -> str:
    """Return false alarms against what was asked for, and delays against size, as SVG."""
    import matplotlib
    from matplotlib.figure import Figure

    with matplotlib.rc_context({'svg.hashsalt': 'monitor', 'svg.fonttype': 'none', 'font.size': 8.0}):
        figure = Figure(figsize=(9.0, 3.4), layout='constrained')
        left, right = figure.subplots(1, 2)
        asked = np.array(list(INTERVALS.values()))
        left.loglog(asked, asked, color='0.7', linewidth=1.0, label='as asked for')
        for shift, (noise, found) in zip((0.94, 1.06), results['drawn'].items()):
            counts = [Count(sum(found['alarms'][label]), found['seconds']) for label in INTERVALS]
            means = np.array([count.seconds / max(count.alarms, 1) for count in counts])
            low, high = np.array([count.interval() for count in counts]).T
            left.errorbar(asked * shift, means, (means - low, high - means), fmt='o', ms=3, capsize=3, label=noise)
        left.set(xlabel='mean time between false alarms that is asked for [s]', ylabel='measured [s]')
        left.set_title('30 days of each noise, 95 % intervals')
        left.legend()
        for trouble in TROUBLES:
            own = [row for row in results['delays'] if row['trouble'] == trouble.title]
            sizes = np.array([row['size'] for row in own]) / trouble.sizes[0]
            delays = np.array([row['seconds']['1 day'] for row in own])
            own_label = f'{trouble.title}; 1 is {trouble.sizes[0]:g} {trouble.unit}'
            (dots,) = right.loglog(sizes, delays, 'o', ms=3, label=own_label)
            steps = np.unique(sizes)
            medians = [np.median(delays[sizes == size]) for size in steps]
            right.loglog(steps, medians, color=dots.get_color(), linewidth=1.0)
        right.set(xlabel='size over the smallest', ylabel='delay [s]')
        right.set_title('Delays at one false alarm a day')
        right.set_ylim(top=20.0 * PATIENCE)  # leaves room for the legend
        right.legend(loc='upper right')
        stream = io.StringIO()
        figure.savefig(stream, format='svg', metadata={'Date': None})
    return stream.getvalue()


def document(results: dict) -> str:
    """Return docs/monitor.md."""
    live = results.get('live')
    told = [
        f'- {when}: {figures["samples"]} samples, {figures["lost"]} lost; from the piston’s sample to its prediction '
        f'{figures["p50"]:.2f} ms (median), {figures["p99"]:.2f} ms (99th percentile), {figures["max"]:.1f} ms at most'
        for when, figures in (live or {}).items()
    ]
    return (
        '\n\n'.join(
            [
                '# What the watch notices, and how often it is wrong',
                'Command: `make monitor-figures`. Machine: ' + machine() + f'. Commit {commit()}.',
                f'Everything at {RATE} Hz: blocks of {BLOCK:g} s, {LEARNING:g} s of learning, two cylinders and the '
                'force (drawn) or two cylinders (rig). Thresholds and whitening were developed on seeds below 1000; '
                f'these are seeds from {FIRST_SEED} on.',
                '## False alarms',
                'Noise is drawn as the rig’s pressure sensor makes it (white, 12 bits), and with a memory of 0.9 from '
                f'sample to sample. Each noise is watched 120 times {WATCH / 3600.0:g} hours, each after a learning '
                'of its own; intervals are exact for a Poisson count (Garwood, 1936). The rig follows random surfaces '
                'while its set-points step every 1 to 4 s; its model was identified from another minute.',
                false_alarm_section(results),
                '![False alarms and delays](monitor.svg)',
                '## Delays',
                'Cylinder A of rigs drawn at random, following a surface. Median and range over rigs; what the loop '
                f'names is what `identify_bag --close-loop` finds in {WINDOW:g} s behind the change against {WINDOW:g} '
                f's before it, in the first rig. *Not met* is not within {PATIENCE:g} s; *listed* is as an alternative '
                'that can’t be told apart.',
                delay_section(results['delays']),
                *(['## In a graph', '\n'.join(told)] if told else []),
                notes_in(DOCUMENT),
            ]
        ).rstrip()
        + '\n'
    )


def main() -> None:
    """Measure what is asked for, and write the document."""
    parser = argparse.ArgumentParser(description='Measure the watch: false alarms and delays.')
    parser.add_argument('parts', nargs='*', help=f'{", ".join(PARTS)}, document; none: all')
    parser.add_argument('--quick', action='store_true', help='a taste of each part, printed only')
    parser.add_argument('--results', type=Path, default=ROOT / 'build' / 'monitor_figures', help='folder of the parts')
    arguments = parser.parse_args()
    arguments.results.mkdir(parents=True, exist_ok=True)
    for name in arguments.parts or [*PARTS, 'document']:
        if name == 'document':
            if arguments.quick:
                continue
            results = {file.stem: json.loads(file.read_text())['result'] for file in arguments.results.glob('*.json')}
            write_text(DOCUMENT, document(results))
            write_text(PICTURE, picture(results))
            continue
        began = time.monotonic()
        found = {'result': PARTS[name](arguments.quick), 'minutes': (time.monotonic() - began) / 60.0}
        print(json.dumps(found), flush=True)
        if not arguments.quick:
            write_text(arguments.results / f'{name}.json', json.dumps(found))


if __name__ == '__main__':
    main()
