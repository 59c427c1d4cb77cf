# SPDX-License-Identifier: Apache-2.0
"""
Count the false alarms of the watch against the mean time between them that is asked for.

    make monitor-figures                 # an hour; writes docs/monitor.md
    make monitor-figures ARGS='--quick'  # a taste, printed

They are counted over residuals that are drawn as the rig's sensors make them, in which the model cancels, and over
hours of the rig itself beside its identified model. Blocks, whitening and charts are the watch's own throughout. Seeds
below 1000 were for developing, those from 1000 on are for what is reported.
"""

from __future__ import annotations

import argparse
import itertools
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from typing import NamedTuple

import numpy as np
from scipy.signal import lfilter
from scipy.stats import chi2

from cfd_pneumatic.convention import CONTACT_FORCE, CYLINDERS
from cfd_pneumatic.device import identified_device
from cfd_pneumatic.files import write_text
from cfd_pneumatic.identification import identify
from cfd_pneumatic.model import DIRECTIONS, DeviceModel
from cfd_pneumatic.monitoring import Chart, ResidualBlock, WatchedSignal
from cfd_pneumatic.recording import recording_of
from cfd_pneumatic.rig import Performance, RigParameters, RigRecord, Sensors, record, surface_following
from studies.documents.markdown import notes_in, table
from studies.panel.specimen import draw_specimen
from studies.tools.provenance import ROOT, commit, machine

RATE = 500  # samples in a second
BLOCK = 0.2  # [s]
SAMPLES = round(RATE * BLOCK)  # in a block
LEARNING = 300.0  # [s]
INTERVALS = {'10 minutes': 600.0, '1 hour': 3600.0, '1 day': 86_400.0}
"""Mean times between false alarms that are asked for [s]."""

CHANNELS = (*CYLINDERS, CONTACT_FORCE)
FIRST_SEED = 1000
EPOCH = 1_700_000_000_000_000_000
SETTLING = 1.0  # of the model [s]
PIECE = 3600.0  # residuals that are drawn at a time [s]
STRETCH = 600.0  # of a rig that is recorded at a time [s]
WATCH = 6 * 3600.0  # after one learning [s]
PLAYED = 1200.0  # duration of a surface, which repeats itself [s]
DOCUMENT = ROOT / 'docs' / 'monitor.md'

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
        channel.add_block(block)
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
    noise_model = baseline.noise_model
    innovations = noise_model.innovations(noise_model.weighted(residuals, rates), np.empty(0))
    features = noise_model.features(innovations.reshape(-1, SAMPLES))
    return {label: sum(map(rings, channel.charts, features)) for label, channel in found.items()}


def rings(chart: Chart, values: np.ndarray) -> int:
    """Return how often a chart rings."""
    alarms = 0
    while (at := chart.update(values)) >= 0:
        alarms += 1
        chart.reset_sums()
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


def surfaces(rig: RigParameters, seed: int, duration: float = 60.0) -> Performance:
    """Return a rig that follows a random surface, over and over."""
    schedule = surface_following(duration=duration, seed=seed).with_return()
    return Performance(schedule, rig, seed=seed, repeat=True)


def residuals_of(device: DeviceModel, got: RigRecord) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Return residuals and rates of each cylinder, in whole blocks from when the model has settled."""
    found = {}
    begin = round(SETTLING * RATE)
    kept = slice(begin, begin + (got.times.size - begin) // SAMPLES * SAMPLES)
    for index, (name, cylinder) in enumerate(zip(CYLINDERS, (device.a, device.b))):
        assert cylinder is not None
        predicted = cylinder.simulate(got.times, DIRECTIONS[name] * got.displacement, got.setpoints[:, index])
        rates = np.diff(predicted, prepend=predicted[:1]) / np.diff(got.times, prepend=got.times[0] - 1.0)
        found[name] = (got.pressures[:, index] - predicted)[kept], rates[kept]
    return found


def rig_alarms(frozen: bool, runs: int, seconds: float) -> dict[str, Count]:
    """
    Return the false alarms on rigs beside their models, for each interval.

    A rig is drawn at random and as the paper's, or the rig as it is. Its model is identified from a minute of it.
    """
    alarms: Counter[str] = Counter()
    watched = 0.0
    for seed in range(FIRST_SEED, FIRST_SEED + runs):
        rig = draw_specimen(np.random.default_rng(seed))[0].rig if frozen else RigParameters()
        got = record(surface_following(duration=60.0, seed=seed), rig, seed=seed)
        device = identified_device(identify([recording_of(got)])).model
        performance = surfaces(rig, seed + 500_000, PLAYED)
        learned = residuals_of(device, performance.advance(round((LEARNING + 3.0) * RATE)))
        found = {name: watchers(blocks_of(*own), name, len(CYLINDERS)) for name, own in learned.items()}
        own_time = 0.0
        while own_time < seconds:
            own = residuals_of(device, performance.advance(round(STRETCH * RATE)))
            for name, channel in found.items():
                alarms.update(alarms_of(channel, *own[name]))
            own_time += own[CYLINDERS[0]][0].size / RATE
        watched += own_time
    return {label: Count(alarms[label], watched) for label in INTERVALS}


# the document


def measured(quick: bool) -> dict[str, dict[str, Count]]:
    """Return the false alarms by what was watched; a taste of it where it is to be quick."""
    runs, seconds = (4, 2 * PIECE) if quick else (120, WATCH)
    found = {f'{draw.__name__} noise, drawn': drawn_alarms(draw, runs, seconds) for draw in (white, coloured)}
    runs, seconds = (1, 2 * STRETCH) if quick else (12, 6 * STRETCH)
    found['rig as the paper’s device, beside its model'] = rig_alarms(True, runs, seconds)
    found['rig as it is, its model without effects'] = rig_alarms(False, runs, seconds)
    return found


def duration(seconds: float) -> str:
    """Return a time as people say it."""
    for unit, size in (('d', 86_400.0), ('h', 3600.0), ('min', 60.0)):
        if seconds >= size:
            return f'{seconds / size:.3g} {unit}'
    return f'{seconds:.3g} s'


def table_of(counts: Mapping[str, Mapping[str, Count]]) -> str:
    """Return the table of false alarms."""
    lines = []
    for title, asked in itertools.product(counts, INTERVALS):
        count = counts[title][asked]
        low, high = count.interval()
        interval = f'{duration(low)} to {duration(high) if np.isfinite(high) else "any"}'
        mean = duration(count.seconds / count.alarms) if count.alarms else 'none'
        expected = f'{count.seconds / INTERVALS[asked]:.3g}'
        lines.append([title, duration(count.seconds), asked, expected, count.alarms, mean, interval])
    heading = ['residual', 'watched', 'asked for', 'expected', 'false alarms', 'mean time between', '95 % interval']
    return table(heading, lines)


def document(counts: Mapping[str, Mapping[str, Count]]) -> str:
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
        table_of(counts),
        notes_in(DOCUMENT),
    ]
    return '\n\n'.join(parts).rstrip() + '\n'


def main() -> None:
    """Count false alarms, and write the document."""
    parser = argparse.ArgumentParser(description='Count the false alarms of the watch.')
    parser.add_argument('--quick', action='store_true', help='a taste, printed only')
    if parser.parse_args().quick:
        print(table_of(measured(quick=True)))
    else:
        write_text(DOCUMENT, document(measured(quick=False)))


if __name__ == '__main__':
    main()
