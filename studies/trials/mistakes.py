# SPDX-License-Identifier: Apache-2.0
"""
Test that `identify_bag` warns about input errors: `make mistakes`.

The errors are those of users, one at a time, in the mapping or in the recording. The recordings are a table as in the
tutorial, recordings of the rig, and a measured run. No input error may lead to a confident verdict.
"""

from __future__ import annotations

import argparse
import copy
import io
import json
import sys
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass
from functools import cache
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from cfd_pneumatic.arrays import Array
from cfd_pneumatic.commands import identify_bag_main as identify_bag
from cfd_pneumatic.convention import AMBIENT_PRESSURE
from cfd_pneumatic.files import write_text
from cfd_pneumatic.identification import Options, identify
from cfd_pneumatic.notices import WARNING
from cfd_pneumatic.recording import Recording, Signal, recording_of
from cfd_pneumatic.rig import Schedule, device_named, out_and_back, paper_step, record, surface_following
from cfd_pneumatic.units import INCH, PSI
from studies.documents.markdown import notes_in, table
from studies.tools.processes import side_by_side
from studies.tools.provenance import DATA, ROOT, machine

Columns = dict[str, Array]
Layout = dict[str, Any]
Change = Callable[[Columns, Layout], None]

SURE = ('effect_added', 'no_missing_effect')

MEASURED = DATA / 'friction' / 'O-ring257_3bar.csv'
EPOCH = 1_700_000_000_000_000_000
CLEAN = range(1000, 1500)
"""Seeds of clean recordings."""
DOCUMENT = ROOT / 'docs' / 'measurements' / 'mistakes.md'


@dataclass(frozen=True)
class Table:
    """
    A table of measurements with its right mapping.

    Attributes
    ----------
    name
        Name of the recording.
    columns
        Columns by header, in the units of the layout.
    layout
        The right mapping.

    """

    name: str
    columns: Columns
    layout: Layout

    def write(self, folder: Path, change: Change) -> tuple[Path, Path]:
        """Write table and mapping after a change; return their paths."""
        columns, layout = dict(self.columns), copy.deepcopy(self.layout)
        change(columns, layout)
        table, mapping = folder / f'{self.name}.csv', folder / f'{self.name}.yaml'
        head = ','.join(columns)
        np.savetxt(table, np.column_stack(list(columns.values())), fmt='%.9g', delimiter=',', header=head, comments='')
        mapping.write_text(yaml.safe_dump(layout), encoding='utf-8')
        return table, mapping


def _values_at(signal: Signal, times: Array) -> Array:
    return signal.values[np.maximum(np.searchsorted(signal.times, times, side='right') - 1, 0)]


def _rows(recording: Recording, displacement: float, pressure: float, ambient: float) -> Columns:
    """Return a recording's signals at the displacement's times, in units given in metres and pascals."""
    times = recording.displacement.times
    columns = {'x': recording.displacement.values / displacement}
    for name, cylinder in zip('AB', recording.cylinders.values()):
        assert cylinder.setpoint is not None
        columns[f'p{name}'] = (np.interp(times, cylinder.pressure.times, cylinder.pressure.values) - ambient) / pressure
        columns[f'set{name}'] = (_values_at(cylinder.setpoint, times) - AMBIENT_PRESSURE) / pressure
    if recording.force is not None:
        columns['F'] = np.interp(times, recording.force.times, recording.force.values)
    return columns


def _pressures(unit: str, reference: str) -> Layout:
    def signals_of(name: str) -> Layout:
        return {
            'pressure': {'column': f'p{name}', 'unit': unit, 'reference': reference},
            'setpoint': {'column': f'set{name}', 'unit': unit, 'reference': 'gauge'},
        }

    return {'cylinder_a': signals_of('A'), 'cylinder_b': signals_of('B')}


def _layout(time: str, displacement: str, **signals: Layout) -> Layout:
    """Return the mapping of a table with signals, given the units of time and displacement."""
    return {
        'table': {'time': {'column': 't', 'unit': time}, 'delimiter': 'comma', 'header_rows': 1},
        'displacement': {'column': 'x', 'unit': displacement},
        **signals,
    }


def _played(schedule: Schedule, seed: int, faults: str = '', device: str = 'paper') -> Recording:
    return recording_of(record(schedule, device_named(device, faults), seed=seed), schedule.name, EPOCH)


def tutorial() -> Table:
    """Return the tutorial's press with a dead band, in ms, mm and gauge psi."""
    recording = _played(surface_following(duration=20.0, seed=0), 0, 'effects_a.dead_band=300')
    columns = {'t': 1e3 * recording.displacement.times, **_rows(recording, 1e-3, PSI, AMBIENT_PRESSURE)}
    del columns['F']
    return Table('tutorial', columns, _layout('ms', 'mm', **_pressures('psi', 'gauge')))


def rig() -> Table:
    """Return a rig with a load cell and a leak, in s, inches and absolute kPa."""
    recording = _played(surface_following(duration=20.0, seed=1), 1, 'effects_a.leak_conductance=1e-10')
    columns = {'t': recording.displacement.times, **_rows(recording, 0.0254, 1e3, 0.0)}
    force = {'column': 'F', 'unit': 'N'}
    return Table('rig', columns, _layout('s', 'inch', **_pressures('kPa', 'absolute'), force=force))


def real() -> Table:
    """Return a healthy device with full physics, in s, mm and gauge bar."""
    recording = _played(surface_following(duration=40.0, seed=3), 3, device='real')
    columns = {'t': recording.displacement.times, **_rows(recording, 1e-3, 1e5, AMBIENT_PRESSURE)}
    del columns['F']
    return Table('real', columns, _layout('s', 'mm', **_pressures('bar', 'gauge')))


def measured() -> Table:
    """Return a measured run of a cylinder, without a recorded set-point."""
    rows = np.loadtxt(MEASURED, skiprows=15)
    columns = {'t': rows[:, 0], 'x': rows[:, 4], 'pA': rows[:, 5], 'F': rows[:, 6]}
    pressure = {'column': 'pA', 'unit': 'bar', 'reference': 'gauge'}
    layout = _layout('ms', 'mm', cylinder_a={'pressure': pressure}, force={'column': 'F', 'unit': 'N'})
    layout['displacement']['sign'] = -1
    return Table('measured', columns, layout)


TABLES: dict[str, Callable[[], Table]] = {make.__name__: cache(make) for make in (tutorial, rig, real, measured)}

PRESSURES = ('cylinder_a.pressure', 'cylinder_b.pressure')
SETPOINTS = ('cylinder_a.setpoint', 'cylinder_b.setpoint')


def entries(**values: object) -> Change:
    """Return a change of entries of the layout; two underscores separate levels in a name."""

    def change(_columns: Columns, layout: Layout) -> None:
        for name, value in values.items():
            *levels, key = name.split('__')
            part = layout
            for level in levels:
                part = part[level]
            part[key] = value

    return change


def every(key: str, value: object, *paths: str) -> Change:
    """Return a change of a key in several parts of the layout."""
    return entries(**{f'{path}.{key}'.replace('.', '__'): value for path in paths})


def without(*paths: str) -> Change:
    """Return a change that removes parts of the layout."""

    def change(_columns: Columns, layout: Layout) -> None:
        for path in paths:
            *levels, key = path.split('.')
            part = layout
            for level in levels:
                part = part[level]
            del part[key]

    return change


def rows(choose: Callable[[Columns], Array | slice]) -> Change:
    """Return a change that selects rows and their order."""

    def change(columns: Columns, _layout: Layout) -> None:
        kept = choose(columns)
        columns.update({name: values[kept] for name, values in columns.items()})

    return change


def changed_device(columns: Columns, _layout: Layout) -> None:
    """Reduce the changes of pressure by 30 % after two thirds, as with a larger chamber."""
    late = columns['t'] > columns['t'][-1] * 2 / 3
    middle = np.median(columns['pA'])
    columns['pA'] = np.where(late, middle + 0.7 * (columns['pA'] - middle), columns['pA'])


def loose_plug(columns: Columns, _layout: Layout) -> None:
    """Set a pressure to zero at five samples."""
    columns['pA'] = columns['pA'].copy()
    columns['pA'][[300, 1500, 4000, 7000, 9000]] = 0.0


def out_of_range(columns: Columns, _layout: Layout) -> None:
    """Limit a pressure to its median."""
    columns['pA'] = np.minimum(columns['pA'], np.median(columns['pA']))


def stuck(columns: Columns, _layout: Layout) -> None:
    """Hold a pressure constant for a third of the time."""
    columns['pA'] = columns['pA'].copy()
    columns['pA'][3000:6000] = columns['pA'][3000]


def absolute_bar(columns: Columns, _layout: Layout) -> None:
    """Write all pressures and set-points as absolute pressures in bar."""
    columns.update({name: columns[name] + 1e-5 * AMBIENT_PRESSURE for name in ('pA', 'pB', 'setA', 'setB')})


def inches_and_psi(columns: Columns, layout: Layout) -> None:
    """Write displacement in inches and pressures in absolute psi; the layout has mm and kPa."""
    columns['x'] = columns['x'] / (1e3 * INCH)
    psi_as_kpa(columns, layout)


def absolute_psi_as_kpa(columns: Columns, layout: Layout) -> None:
    """Write all pressures in absolute psi instead of gauge bar; the layout has gauge kPa."""
    absolute_bar(columns, layout)
    columns.update({name: 1e5 / PSI * columns[name] for name in ('pA', 'pB', 'setA', 'setB')})
    every('unit', 'kPa', *PRESSURES, *SETPOINTS)(columns, layout)


def psi_as_kpa(columns: Columns, layout: Layout) -> None:
    """Write all pressures in absolute psi instead of gauge psi; the layout has gauge kPa."""
    columns.update({name: columns[name] + AMBIENT_PRESSURE / PSI for name in ('pA', 'pB', 'setA', 'setB')})
    every('unit', 'kPa', *PRESSURES, *SETPOINTS)(columns, layout)


def kpa_as_psi(columns: Columns, layout: Layout) -> None:
    """Write all pressures in gauge kPa; the layout has psi."""
    columns.update({name: 1e2 * columns[name] for name in ('pA', 'pB', 'setA', 'setB')})
    every('unit', 'psi', *PRESSURES, *SETPOINTS)(columns, layout)


def columns_of(**names: str) -> Change:
    """Return a change of the columns of signals."""
    return entries(**{f'{path}__column': name for path, name in names.items()})


@dataclass(frozen=True)
class Mistake:
    """
    An input error of a user.

    Attributes
    ----------
    table, description
        Name of the table, and description for people.
    change
        Change of table and layout.
    codes
        Right codes: the warnings, or the error message, must have at least one.
    arguments
        Further arguments of the program.
    twice
        Whether the program gets the recording twice.

    """

    table: str
    description: str
    change: Change
    codes: tuple[str, ...]
    arguments: tuple[str, ...] = ()
    twice: bool = False


UNIT, REFERENCE, SETPOINT = ('unit_suspect',), ('reference_suspect',), ('setpoint_suspect',)
SAMPLES = ('samples_suspect',)
LEFT_OUT = 'left out'
"""Pseudo-code of a note in the report: the wrong samples were left out."""

CHANGED = 'changed_during_recording'
SIGN, SWAPPED, ERROR = ('sign_suspect', 'cylinders_swapped'), ('cylinders_swapped', 'setpoint_suspect'), ('error',)


def _of_both_tables() -> Iterator[Mistake]:
    """Yield input errors with two cylinders, of the tutorial's table and the rig's."""
    for name in ('tutorial', 'rig'):
        yield Mistake(name, 'mm or inch read as m', entries(displacement__unit='m'), UNIT)
        yield Mistake(name, 'everything in bar', every('unit', 'bar', *PRESSURES, *SETPOINTS), UNIT)
        yield Mistake(name, 'everything in Pa', every('unit', 'Pa', *PRESSURES, *SETPOINTS), (*UNIT, *REFERENCE))
        yield Mistake(name, 'one pressure in bar', entries(cylinder_a__pressure__unit='bar'), UNIT)
        yield Mistake(name, 'set-points absolute', every('reference', 'absolute', *SETPOINTS), REFERENCE)
        swapped = columns_of(cylinder_a__pressure='setA', cylinder_a__setpoint='pA')
        yield Mistake(name, 'pressure and set-point swapped', swapped, SETPOINT)
        yield Mistake(name, "the other's set-point", columns_of(cylinder_a__setpoint='setB'), SETPOINT)
        crossed = columns_of(cylinder_a__setpoint='setB', cylinder_b__setpoint='setA')
        yield Mistake(name, 'set-points swapped', crossed, SWAPPED)
        crossed = columns_of(cylinder_a__pressure='pB', cylinder_b__pressure='pA')
        yield Mistake(name, 'pressures swapped', crossed, SWAPPED)
        both = {'cylinder_a__pressure': 'pB', 'cylinder_b__pressure': 'pA'}
        both |= {'cylinder_a__setpoint': 'setB', 'cylinder_b__setpoint': 'setA'}
        yield Mistake(name, 'cylinders swapped', columns_of(**both), SIGN)
        yield Mistake(name, 'displacement the other way', entries(displacement__sign=-1), SIGN)
        yield Mistake(name, 'no set-points', without(*SETPOINTS), ('setpoint_assumed',))
        yield Mistake(name, 'upside down', rows(lambda _: slice(None, None, -1)), ERROR)
        yield Mistake(name, 'the same twice', entries(), ('duplicate_recording',), twice=True)
        yield Mistake(name, 'another device from two thirds on', changed_device, (CHANGED,))
        yield Mistake(name, 'a loose plug', loose_plug, (*SAMPLES, LEFT_OUT))
        yield Mistake(name, 'a sensor at its limit', out_of_range, SAMPLES)
        yield Mistake(name, 'a logger that hangs', stuck, SAMPLES)
        yield Mistake(name, 'every fortieth row', rows(lambda _: slice(None, None, 40)), ('sampling_slow',))


def _of_single_tables() -> Iterator[Mistake]:
    """Yield input errors that are possible with a single table."""
    yield Mistake('tutorial', 'inches read as mm, absolute psi as kPa', inches_and_psi, UNIT)
    yield Mistake('tutorial', 'absolute psi read as kPa', psi_as_kpa, UNIT)
    yield Mistake('tutorial', 'mm read as inch', entries(displacement__unit='inch'), UNIT)
    yield Mistake('tutorial', 'mm read as um', entries(displacement__unit='um'), UNIT)
    yield Mistake('tutorial', 'mm read as mil', entries(displacement__unit='mil'), UNIT)
    yield Mistake('tutorial', 'ms read as s', entries(table__time__unit='s'), UNIT)
    yield Mistake('tutorial', 'ms read as us', entries(table__time__unit='us'), UNIT)
    yield Mistake('tutorial', 'psi read as kPa', every('unit', 'kPa', *PRESSURES, *SETPOINTS), UNIT)
    yield Mistake('tutorial', 'one pressure in kPa', entries(cylinder_a__pressure__unit='kPa'), (*UNIT, *SETPOINT))
    yield Mistake('tutorial', 'pressures in kPa', every('unit', 'kPa', *PRESSURES), (*UNIT, *SETPOINT))
    everything = every('reference', 'absolute', *PRESSURES, *SETPOINTS)
    yield Mistake('tutorial', 'everything absolute', everything, REFERENCE)
    yield Mistake('tutorial', 'one pressure absolute', entries(cylinder_a__pressure__reference='absolute'), REFERENCE)
    yield Mistake('tutorial', 'pressures absolute', every('reference', 'absolute', *PRESSURES), REFERENCE)
    yield Mistake('real', 'everything absolute, read as gauge', absolute_bar, REFERENCE)
    yield Mistake('real', 'absolute psi read as kPa', absolute_psi_as_kpa, UNIT)
    yield Mistake('real', 'kPa read as psi', kpa_as_psi, UNIT)
    yield Mistake('real', 'no set-points', without(*SETPOINTS), ('setpoint_assumed',))
    yield Mistake('rig', 'inch read as mm', entries(displacement__unit='mm'), UNIT)
    yield Mistake('rig', 's read as ms', entries(table__time__unit='ms'), UNIT)
    yield Mistake('rig', 'kPa read as psi', every('unit', 'psi', *PRESSURES, *SETPOINTS), (*UNIT, *SETPOINT))
    yield Mistake('rig', 'pressures in psi', every('unit', 'psi', *PRESSURES), (*UNIT, *SETPOINT))
    yield Mistake('rig', 'pressures gauge', every('reference', 'gauge', *PRESSURES), REFERENCE)
    yield Mistake('rig', 'one pressure gauge', entries(cylinder_a__pressure__reference='gauge'), REFERENCE)
    yield Mistake('rig', 'force the other way', entries(force__sign=-1), SIGN)
    yield Mistake('rig', 'N read as kN', entries(force__unit='kN'), UNIT)
    known = ('--area', '1.14e-3')
    yield Mistake('rig', 'N read as lbf, area known', entries(force__unit='lbf'), ('area_suspect',), known)
    half = ('--area', '0.5e-3')
    yield Mistake('rig', 'half the area', entries(), ('area_suspect',), half)
    ambient = ('--ambient-pressure', '2e4')
    yield Mistake('rig', 'ambient pressure of 20 kPa', entries(), (*REFERENCE, 'setpoint_suspect'), ambient)


def _of_measured() -> Iterator[Mistake]:
    """Yield input errors of the measured run."""
    pressure = PRESSURES[0]
    yield Mistake('measured', 'mm read as m', entries(displacement__unit='m'), UNIT)
    yield Mistake('measured', 'mm read as inch', entries(displacement__unit='inch'), UNIT)
    yield Mistake('measured', 'ms read as s', entries(table__time__unit='s'), UNIT)
    yield Mistake('measured', 'bar read as psi', every('unit', 'psi', pressure), UNIT)
    yield Mistake('measured', 'bar read as kPa', every('unit', 'kPa', pressure), UNIT)
    yield Mistake('measured', 'bar read as MPa', every('unit', 'MPa', pressure), UNIT)
    yield Mistake('measured', 'bar read as Pa', every('unit', 'Pa', pressure), UNIT)
    yield Mistake('measured', 'displacement the other way', entries(displacement__sign=1), SIGN)
    yield Mistake('measured', 'force the other way', entries(force__sign=-1), SIGN)
    yield Mistake('measured', 'N read as kN', entries(force__unit='kN'), UNIT)
    yield Mistake('measured', 'upside down', rows(lambda _: slice(None, None, -1)), ERROR)
    yield Mistake('measured', 'the same twice', entries(), ('duplicate_recording',), twice=True)


MISTAKES = (*_of_both_tables(), *_of_single_tables(), *_of_measured())


ERROR_TEXTS = {
    'unit_suspect': 'unit',
    'reference_suspect': 'reference',
    'setpoint_suspect': 'set-point',
    'sign_suspect': 'sign',
    'cylinders_swapped': 'swapped',
    'sampling_slow': 'sample',
    'samples_suspect': 'freezes',
    'setpoint_assumed': 'was not recorded, and it steps',
    'error': 'time runs backwards',
}
"""Text of an error message for each code."""


@dataclass(frozen=True)
class Answer:
    """
    Answer of the program to an input error.

    Attributes
    ----------
    codes
        Codes of the warnings; `error` if the identification failed.
    text
        The first right warning, else the first warning, or the error message.
    confident
        Channels with a confident verdict.

    """

    codes: tuple[str, ...]
    text: str
    confident: tuple[str, ...]


def answer(mistake: Mistake) -> Answer:
    """Return the answer of the program to an input error."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        table, mapping = TABLES[mistake.table]().write(folder, mistake.change)
        bags = [str(table)] * (2 if mistake.twice else 1)
        arguments = [*bags, '--mapping', str(mapping), '--close-loop', '--output', str(folder / 'out')]
        with redirect_stdout(io.StringIO()), redirect_stderr(io.StringIO()) as errors:
            exit_code = identify_bag([*arguments, *mistake.arguments])
        if exit_code:
            return Answer(('error',), errors.getvalue().strip().replace(f'{folder}/', ''), ())
        report = json.loads((folder / 'out' / 'report.json').read_text(encoding='utf-8'))
    channels = {**report['cylinders'], **({'force': report['force']} if 'force' in report else {})}
    confident = [
        name for name, channel in channels.items() if channel['verdict'] in SURE and channel['status'] == 'confirmed'
    ]
    warnings = [warning for warning in report['warnings'] if warning['level'] == WARNING or warning['code'] == CHANGED]
    first = next(
        (warning for warning in warnings if warning['code'] in mistake.codes), warnings[0] if warnings else None
    )
    text = f'{first["message"]}: {first["fix"]}' if first else ''
    codes = [warning['code'] for warning in warnings]
    notes = [note for recording in report['recordings'] for note in recording['notes'] if LEFT_OUT in note]
    if notes and LEFT_OUT in mistake.codes:
        codes, text = [*codes, LEFT_OUT], text or notes[0]
    return Answer(tuple(dict.fromkeys(codes)), text, tuple(confident))


def is_reported(mistake: Mistake, answer: Answer) -> bool:
    """Return whether a right code is reported without a confident verdict, or wrong samples are left out."""
    if 'error' in answer.codes:
        return any(ERROR_TEXTS[code] in answer.text for code in mistake.codes)
    if LEFT_OUT in answer.codes:
        return True
    # The parts before and after a change are identified separately, and each may have a confident verdict.
    is_unsure = not answer.confident or CHANGED in mistake.codes
    return is_unsure and bool({*answer.codes} & {*mistake.codes})


def warnings_of_clean(seed: int) -> list[str]:
    """Return the warnings about a recording of the rig without an input error."""
    rng = np.random.default_rng(seed)
    kind: Callable[..., Schedule] = (surface_following, out_and_back, paper_step)[rng.integers(3)]
    device = ('paper', 'real')[rng.integers(2)]
    levels = {'setpoint': float(rng.uniform(3e4, 1.1e5)), 'setpoint_b': float(rng.uniform(3e4, 1.1e5))}
    length = {'duration': 20.0, 'seed': seed} if kind is surface_following else {}
    schedule = kind(**levels, amplitude=float(rng.uniform(0.4e-3, 1.2e-3)), **length)
    recording = recording_of(record(schedule, device_named(device, ''), seed=seed))
    identification = identify([recording], Options(close_loop=True))
    return [
        f'seed {seed}, {device}, {schedule.name}: {notice}'
        for notice in identification.notices
        if notice.level == WARNING
    ]


def warnings_of_all_clean() -> list[str]:
    """Return the warnings about all clean recordings."""
    return list(chain.from_iterable(side_by_side(warnings_of_clean, CLEAN, 'clean recordings')))


def document(answers: Sequence[tuple[Mistake, Answer]], clean: Sequence[str], notes: str) -> str:
    """Return the document: the answer to each input error, and the warnings about clean recordings."""
    reported = sum(is_reported(mistake, answer) for mistake, answer in answers)
    lines = [(mistake.table, mistake.description, ', '.join(answer.codes), answer.text) for mistake, answer in answers]
    counts = Counter(code for _, answer in answers for code in answer.codes)
    return '\n'.join(
        [
            '# Input errors',
            '',
            'Answers of `identify_bag` to input errors. Written by `make mistakes`; the section '
            '"Notes" at the end is kept.',
            '',
            '- `tutorial`: the table of the tutorial, gauge psi, a dead band. `rig`: absolute kPa, inches, a '
            'load cell, a leak. `real`: a healthy device with full physics, gauge bar. `measured`: a measured '
            f'run of a cylinder, `{MEASURED.stem}`.',
            f'- {len(answers)} input errors. {reported} are reported with a right code, without a confident verdict.',
            f'- Codes: {", ".join(f"`{code}` {count}" for code, count in counts.most_common())}. `error`: the '
            'program ends with exit code 2.',
            f'- {len(clean)} warnings about {len(CLEAN)} clean recordings of the rig (seeds {CLEAN[0]} to {CLEAN[-1]}; '
            'devices `paper` and `real`, three schedules, random levels and strokes).',
            *(f'  - {warning}' for warning in clean),
            f'- Machine: {machine()}',
            '',
            table(('table', 'input error', 'codes', 'first message'), lines),
            '',
            notes,
        ]
    )


def main(arguments: Sequence[str] | None = None) -> int:
    """Try each input error and write the document; return 1 if an input error is not reported."""
    parser = argparse.ArgumentParser(prog='mistakes', description=__doc__.split('\n\n')[0])
    parser.add_argument('--output', type=Path, default=DOCUMENT, help='document to write')
    options = parser.parse_args(arguments)
    answers = []
    for mistake in MISTAKES:
        answers.append((mistake, answer(mistake)))
        result = 'reported' if is_reported(*answers[-1]) else 'MISSED  '
        print(f'{result}  {mistake.table}: {mistake.description}: {answers[-1][1].text}')
    clean = warnings_of_all_clean()
    write_text(options.output, document(answers, clean, notes_in(options.output)))
    return 0 if all(is_reported(*pair) for pair in answers) and not clean else 1


if __name__ == '__main__':
    sys.exit(main())
