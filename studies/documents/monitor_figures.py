# SPDX-License-Identifier: Apache-2.0
"""
Count the false alarms of the watch, and compare the count with the required mean time between false alarms.

    make monitor-figures                 # an hour; writes docs/measurements/monitor.md
    make monitor-figures ARGS='--quick'  # a few hours of residuals, printed

The residuals are random sensor noise, and residuals of the rig against its identified model. Blocks, whitening and
charts are those of the watch. Seeds below 1000 were used for development; seeds from 1000 on are reported.
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
"""Required mean times between false alarms [s]."""

CHANNELS = (*CYLINDERS, CONTACT_FORCE)
FIRST_SEED = 1000
EPOCH = 1_700_000_000_000_000_000
SETTLING = 1.0  # of the model [s]
PIECE = 3600.0  # of random residuals in memory [s]
STRETCH = 600.0  # of a rig's recording in memory [s]
WATCH = 6 * 3600.0  # after each learning [s]
SURFACE_DURATION = 1200.0  # of a surface, which repeats [s]
DOCUMENT = ROOT / 'docs' / 'measurements' / 'monitor.md'

Draw = Callable[[np.random.Generator, int], np.ndarray]


class Count(NamedTuple):
    """Number of false alarms in a watched time."""

    alarms: int
    seconds: float

    def interval(self) -> tuple[float, float]:
        """Return the exact 95 % interval of the mean time between false alarms [s] (Garwood, 1936)."""
        most = 0.5 * chi2.ppf(0.975, 2 * self.alarms + 2)
        least = 0.5 * chi2.ppf(0.025, 2 * self.alarms) if self.alarms else 0.0
        return self.seconds / most, self.seconds / least if least else np.inf


# false alarms over random residuals


def white(rng: np.random.Generator, count: int) -> np.ndarray:
    """Return the error of a pressure sensor: white noise and the converter's rounding [Pa]."""
    sensors = Sensors()
    level = sensors.pressure_range[0] + 7e4 + rng.uniform(0.0, sensors.step(sensors.pressure_range))
    return sensors.measure_pressure(np.full(count, level), rng) - level


def coloured(rng: np.random.Generator, count: int) -> np.ndarray:
    """Return autocorrelated noise with the sensor's standard deviation, as in the panel [Pa]."""
    correlation = 0.9
    innovations = rng.standard_normal(count + 100) * Sensors().pressure_noise * np.sqrt(1.0 - correlation**2)
    return lfilter([1.0], [1.0, -correlation], innovations)[100:]


def watched_signals(blocks: Iterator[ResidualBlock], name: str, channels: int) -> dict[str, WatchedSignal]:
    """Return a watched signal for each interval, with a baseline learned from the first blocks."""
    learning, length = round(LEARNING / BLOCK), round(BLOCK * 1e9)
    signals = {
        label: WatchedSignal(name, learning, length, channels * interval / BLOCK)
        for label, interval in INTERVALS.items()
    }
    for block, channel in itertools.product(itertools.islice(blocks, learning), signals.values()):
        channel.add_block(block)
    return signals


def blocks_of(residuals: np.ndarray, rates: np.ndarray) -> Iterator[ResidualBlock]:
    """Yield the blocks of a residual."""
    for number in range(residuals.size // SAMPLES):
        part = slice(number * SAMPLES, (number + 1) * SAMPLES)
        yield ResidualBlock(EPOCH + round(number * BLOCK * 1e9), residuals[part], rates[part])


def alarms_of(signals: dict[str, WatchedSignal], residuals: np.ndarray, rates: np.ndarray) -> dict[str, int]:
    """Return the number of alarms over the blocks of a residual, for each interval."""
    baseline = next(iter(signals.values())).baseline
    assert baseline is not None  # the watched signals have learned
    noise_model = baseline.noise_model
    innovations = noise_model.innovations(noise_model.weighted(residuals, rates), np.empty(0))
    features = noise_model.features(innovations.reshape(-1, SAMPLES))
    return {label: sum(map(chart_alarms, signal.charts, features)) for label, signal in signals.items()}


def chart_alarms(chart: Chart, values: np.ndarray) -> int:
    """Return the number of alarms of a chart."""
    alarms = 0
    while (index := chart.update(values)) >= 0:
        alarms += 1
        chart.reset_sums()
        values = values[index + 1 :]
    return alarms


def noise_alarms(draw: Draw, runs: int, seconds: float) -> dict[str, Count]:
    """Return the false alarms over random residuals for each interval; each run learns a new baseline."""
    alarms: Counter[str] = Counter()
    for seed in range(FIRST_SEED, FIRST_SEED + runs):
        for name, child in zip(CHANNELS, np.random.SeedSequence(seed).spawn(len(CHANNELS))):
            rng = np.random.default_rng(child)
            learned = draw(rng, round((LEARNING + 1.0) * RATE))
            signals = watched_signals(blocks_of(learned, np.zeros_like(learned)), name, len(CHANNELS))
            for _ in range(round(seconds / PIECE)):
                residuals = draw(rng, round(PIECE * RATE))
                alarms.update(alarms_of(signals, residuals, np.zeros_like(residuals)))
    return {label: Count(alarms[label], runs * seconds) for label in INTERVALS}


# the rig and its model


def surfaces(rig: RigParameters, seed: int, duration: float = 60.0) -> Performance:
    """Return a rig that follows a random surface repeatedly."""
    schedule = surface_following(duration=duration, seed=seed).with_return()
    return Performance(schedule, rig, seed=seed, repeat=True)


def residuals_of(device: DeviceModel, recorded: RigRecord) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Return residuals and rates of each cylinder, in whole blocks after the model has settled."""
    residuals = {}
    begin = round(SETTLING * RATE)
    settled = slice(begin, begin + (recorded.times.size - begin) // SAMPLES * SAMPLES)
    for index, (name, cylinder) in enumerate(zip(CYLINDERS, (device.a, device.b))):
        assert cylinder is not None
        predicted = cylinder.simulate(
            recorded.times, DIRECTIONS[name] * recorded.displacement, recorded.setpoints[:, index]
        )
        rates = np.diff(predicted, prepend=predicted[:1]) / np.diff(recorded.times, prepend=recorded.times[0] - 1.0)
        residuals[name] = (recorded.pressures[:, index] - predicted)[settled], rates[settled]
    return residuals


def rig_alarms(frozen: bool, runs: int, seconds: float) -> dict[str, Count]:
    """
    Return the false alarms over residuals of rigs against their models, for each interval.

    If `frozen`, the rigs are random devices that follow the paper's model; else each is the default rig. The model is
    identified from a minute of the rig.
    """
    alarms: Counter[str] = Counter()
    watched = 0.0
    for seed in range(FIRST_SEED, FIRST_SEED + runs):
        rig = draw_specimen(np.random.default_rng(seed))[0].rig if frozen else RigParameters()
        recorded = record(surface_following(duration=60.0, seed=seed), rig, seed=seed)
        device = identified_device(identify([recording_of(recorded)])).model
        performance = surfaces(rig, seed + 500_000, SURFACE_DURATION)
        learned = residuals_of(device, performance.advance(round((LEARNING + 3.0) * RATE)))
        signals_by_name = {
            name: watched_signals(blocks_of(*residuals), name, len(CYLINDERS)) for name, residuals in learned.items()
        }
        watched_on_rig = 0.0
        while watched_on_rig < seconds:
            residuals = residuals_of(device, performance.advance(round(STRETCH * RATE)))
            for name, signals in signals_by_name.items():
                alarms.update(alarms_of(signals, *residuals[name]))
            watched_on_rig += residuals[CYLINDERS[0]][0].size / RATE
        watched += watched_on_rig
    return {label: Count(alarms[label], watched) for label in INTERVALS}


# the document


def measured(quick: bool) -> dict[str, dict[str, Count]]:
    """Return the false alarms by kind of residual; `quick` watches a shorter time."""
    runs, seconds = (4, 2 * PIECE) if quick else (120, WATCH)
    counts = {f'{draw.__name__} noise, random': noise_alarms(draw, runs, seconds) for draw in (white, coloured)}
    runs, seconds = (1, 2 * STRETCH) if quick else (12, 6 * STRETCH)
    counts['rig that follows the paper’s model'] = rig_alarms(True, runs, seconds)
    counts['default rig, model without effects'] = rig_alarms(False, runs, seconds)
    return counts


def duration(seconds: float) -> str:
    """Return a time as text, in a suitable unit."""
    for unit, size in (('d', 86_400.0), ('h', 3600.0), ('min', 60.0)):
        if seconds >= size:
            return f'{seconds / size:.3g} {unit}'
    return f'{seconds:.3g} s'


def table_of(counts: Mapping[str, Mapping[str, Count]]) -> str:
    """Return the table of false alarms."""
    lines = []
    for title, required in itertools.product(counts, INTERVALS):
        count = counts[title][required]
        low, high = count.interval()
        interval = f'{duration(low)} to {duration(high) if np.isfinite(high) else "any"}'
        mean = duration(count.seconds / count.alarms) if count.alarms else 'none'
        expected = f'{count.seconds / INTERVALS[required]:.3g}'
        lines.append([title, duration(count.seconds), required, expected, count.alarms, mean, interval])
    heading = [
        'residual',
        'watched',
        'required interval',
        'expected',
        'false alarms',
        'mean time between',
        '95 % interval',
    ]
    return table(heading, lines)


def document(counts: Mapping[str, Mapping[str, Count]]) -> str:
    """Return the text of docs/measurements/monitor.md."""
    parts = [
        '# False alarms of the watch',
        f'Command: `make monitor-figures`. Machine: {machine()}. Commit {commit()}.',
        f'How many false alarms does the watch give? Rate {RATE} Hz, blocks of {BLOCK:g} s, {LEARNING:g} s of '
        'learning. Channels: two cylinders and the force (random noise), or two cylinders (rig). Seeds below '
        f'1000 were used for development; the reported seeds begin at {FIRST_SEED}.',
        '## Counts',
        'The random noise is that of the rig’s pressure sensor (white, 12 bits), or autocorrelated with 0.9 between '
        f'samples. Each noise is watched 120 times for {WATCH / 3600.0:g} hours, after a new learning. Intervals are '
        'exact for a Poisson count (Garwood, 1936). The rig follows random surfaces while its set-points step every 1 '
        'to 4 s. Its model was identified from a separate minute.',
        table_of(counts),
        notes_in(DOCUMENT),
    ]
    return '\n\n'.join(parts).rstrip() + '\n'


def main() -> None:
    """Count false alarms and write the document."""
    parser = argparse.ArgumentParser(description='Count the false alarms of the watch.')
    parser.add_argument('--quick', action='store_true', help='watch a shorter time, and print the table only')
    if parser.parse_args().quick:
        print(table_of(measured(quick=True)))
    else:
        write_text(DOCUMENT, document(measured(quick=False)))


if __name__ == '__main__':
    main()
