# SPDX-License-Identifier: Apache-2.0
"""
What is said of recordings that were read wrongly: make mistakes.

Mistakes that users make, one at a time, in the mapping or in the recording itself: of a table as the tutorial makes it,
of a bag of the rig with a measured force, and of a measured run. None may end in a confident verdict.
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


@dataclass(frozen=True)
class Table:
    """
    Measurements as somebody has them.

    Attributes
    ----------
    name
        Of the recording.
    columns
        By their heads, in the units that the layout names.
    layout
        The mapping that is right.

    """

    name: str
    columns: Columns
    layout: Layout

    def written(self, folder: Path, change: Change) -> tuple[Path, Path]:
        """Write the table and its mapping after a change; return where they are."""
        columns, layout = dict(self.columns), copy.deepcopy(self.layout)
        change(columns, layout)
        table, mapping = folder / f'{self.name}.csv', folder / f'{self.name}.yaml'
        head = ','.join(columns)
        np.savetxt(table, np.column_stack(list(columns.values())), fmt='%.9g', delimiter=',', header=head, comments='')
        mapping.write_text(yaml.safe_dump(layout), encoding='utf-8')
        return table, mapping


def _held(signal: Signal, times: Array) -> Array:
    return signal.values[np.maximum(np.searchsorted(signal.times, times, side='right') - 1, 0)]


def _rows(recording: Recording, displacement: float, pressure: float, ambient: float) -> Columns:
    """Return a recording's signals at the displacement's times, in units of so many metres and pascals."""
    times = recording.displacement.times
    columns = {'x': recording.displacement.values / displacement}
    for name, own in zip('AB', recording.cylinders.values()):
        assert own.setpoint is not None
        columns[f'p{name}'] = (np.interp(times, own.pressure.times, own.pressure.values) - ambient) / pressure
        columns[f'set{name}'] = (_held(own.setpoint, times) - AMBIENT_PRESSURE) / pressure
    if recording.force is not None:
        columns['F'] = np.interp(times, recording.force.times, recording.force.values)
    return columns


def _pressures(unit: str, reference: str) -> Layout:
    def of(name: str) -> Layout:
        return {
            'pressure': {'column': f'p{name}', 'unit': unit, 'reference': reference},
            'setpoint': {'column': f'set{name}', 'unit': unit, 'reference': 'gauge'},
        }

    return {'cylinder_a': of('A'), 'cylinder_b': of('B')}


def _layout(time: str, displacement: str, **signals: Layout) -> Layout:
    """Return the mapping of a table of signals, by the units of time and displacement."""
    return {
        'table': {'time': {'column': 't', 'unit': time}, 'delimiter': 'comma', 'header_rows': 1},
        'displacement': {'column': 'x', 'unit': displacement},
        **signals,
    }


def _played(schedule: Schedule, seed: int, faults: str = '', device: str = 'paper') -> Recording:
    return recording_of(record(schedule, device_named(device, faults), seed=seed), schedule.name, EPOCH)


def tutorial() -> Table:
    """Return the tutorial's press: milliseconds, millimetres, psi above ambient; a dead band."""
    recording = _played(surface_following(duration=20.0, seed=0), 0, 'effects_a.dead_band=300')
    columns = {'t': 1e3 * recording.displacement.times, **_rows(recording, 1e-3, PSI, AMBIENT_PRESSURE)}
    del columns['F']
    return Table('tutorial', columns, _layout('ms', 'mm', **_pressures('psi', 'gauge')))


def rig() -> Table:
    """Return a rig with a load cell: seconds, inches, absolute kPa; a leak."""
    recording = _played(surface_following(duration=20.0, seed=1), 1, 'effects_a.leak_conductance=1e-10')
    columns = {'t': recording.displacement.times, **_rows(recording, 0.0254, 1e3, 0.0)}
    force = {'column': 'F', 'unit': 'N'}
    return Table('rig', columns, _layout('s', 'inch', **_pressures('kPa', 'absolute'), force=force))


def real() -> Table:
    """Return a healthy device of full physics: seconds, millimetres, bar above ambient."""
    recording = _played(surface_following(duration=40.0, seed=3), 3, device='real')
    columns = {'t': recording.displacement.times, **_rows(recording, 1e-3, 1e5, AMBIENT_PRESSURE)}
    del columns['F']
    return Table('real', columns, _layout('s', 'mm', **_pressures('bar', 'gauge')))


def measured() -> Table:
    """Return a measured run of one cylinder, whose set-point was not recorded."""
    rows = np.loadtxt(MEASURED, skiprows=15)
    columns = {'t': rows[:, 0], 'x': rows[:, 4], 'pA': rows[:, 5], 'F': rows[:, 6]}
    pressure = {'column': 'pA', 'unit': 'bar', 'reference': 'gauge'}
    layout = _layout('ms', 'mm', cylinder_a={'pressure': pressure}, force={'column': 'F', 'unit': 'N'})
    layout['displacement']['sign'] = -1
    return Table('measured', columns, layout)


TABLES: dict[str, Callable[[], Table]] = {one.__name__: cache(one) for one in (tutorial, rig, real, measured)}

PRESSURES = ('cylinder_a.pressure', 'cylinder_b.pressure')
SETPOINTS = ('cylinder_a.setpoint', 'cylinder_b.setpoint')


def entries(**values: object) -> Change:
    """Return a change of entries of the layout; their names have two underscores where the file has a level."""

    def change(_columns: Columns, layout: Layout) -> None:
        for name, value in values.items():
            *levels, key = name.split('__')
            part = layout
            for level in levels:
                part = part[level]
            part[key] = value

    return change


def every(key: str, value: object, *paths: str) -> Change:
    """Return a change of the same key in several parts of the layout."""
    return entries(**{f'{path}.{key}'.replace('.', '__'): value for path in paths})


def without(*paths: str) -> Change:
    """Return a change that leaves parts of the layout out."""

    def change(_columns: Columns, layout: Layout) -> None:
        for path in paths:
            *levels, key = path.split('.')
            part = layout
            for level in levels:
                part = part[level]
            del part[key]

    return change


def rows(choose: Callable[[Columns], Array | slice]) -> Change:
    """Return a change that keeps some rows, in an order."""

    def change(columns: Columns, _layout: Layout) -> None:
        kept = choose(columns)
        columns.update({name: values[kept] for name, values in columns.items()})

    return change


def other_device(columns: Columns, _layout: Layout) -> None:
    """Let another piston, with a third more volume, go on after two thirds."""
    late = columns['t'] > columns['t'][-1] * 2 / 3
    middle = np.median(columns['pA'])
    columns['pA'] = np.where(late, middle + 0.7 * (columns['pA'] - middle), columns['pA'])


def loose_plug(columns: Columns, _layout: Layout) -> None:
    """Let a pressure be zero at five samples."""
    columns['pA'] = columns['pA'].copy()
    columns['pA'][[300, 1500, 4000, 7000, 9000]] = 0.0


def out_of_range(columns: Columns, _layout: Layout) -> None:
    """Let a sensor go no higher than a pressure mostly is."""
    columns['pA'] = np.minimum(columns['pA'], np.median(columns['pA']))


def stuck(columns: Columns, _layout: Layout) -> None:
    """Let a pressure hang for a third of the time."""
    columns['pA'] = columns['pA'].copy()
    columns['pA'][3000:6000] = columns['pA'][3000]


def counted_from_nothing(columns: Columns, _layout: Layout) -> None:
    """Write all pressures and set-points as absolute ones, in bar."""
    columns.update({name: columns[name] + 1e-5 * AMBIENT_PRESSURE for name in ('pA', 'pB', 'setA', 'setB')})


def inches_and_psi(columns: Columns, layout: Layout) -> None:
    """Write mm and psi as inch and absolute psi, and read them as mm and kPa."""
    columns['x'] = columns['x'] / (1e3 * INCH)
    psi_as_kpa(columns, layout)


def absolute_psi_as_kpa(columns: Columns, layout: Layout) -> None:
    """Write all pressures in absolute psi, and read them as kPa above ambient."""
    counted_from_nothing(columns, layout)
    columns.update({name: 1e5 / PSI * columns[name] for name in ('pA', 'pB', 'setA', 'setB')})
    every('unit', 'kPa', *PRESSURES, *SETPOINTS)(columns, layout)


def psi_as_kpa(columns: Columns, layout: Layout) -> None:
    """Write all pressures in absolute psi instead of psi above ambient, and read them as kPa above ambient."""
    columns.update({name: columns[name] + AMBIENT_PRESSURE / PSI for name in ('pA', 'pB', 'setA', 'setB')})
    every('unit', 'kPa', *PRESSURES, *SETPOINTS)(columns, layout)


def kpa_as_psi(columns: Columns, layout: Layout) -> None:
    """Write all pressures in kPa above ambient, and read them as psi."""
    columns.update({name: 1e2 * columns[name] for name in ('pA', 'pB', 'setA', 'setB')})
    every('unit', 'psi', *PRESSURES, *SETPOINTS)(columns, layout)


def columns_of(**names: str) -> Change:
    """Return a change of which column a signal is in."""
    return entries(**{f'{path}__column': name for path, name in names.items()})


@dataclass(frozen=True)
class Mistake:
    """
    A mistake.

    Attributes
    ----------
    on, what
        Of which table, and in words.
    change
        What it does to table and layout.
    codes
        One of which has to be said, or of which the error has to be.
    arguments
        Further ones of the program.
    twice
        Whether the same recording is given twice.

    """

    on: str
    what: str
    change: Change
    codes: tuple[str, ...]
    arguments: tuple[str, ...] = ()
    twice: bool = False


UNIT, REFERENCE, SETPOINT = ('unit_suspect',), ('reference_suspect',), ('setpoint_suspect',)
SAMPLES = ('samples_suspect',)
LEFT_OUT = 'left out'
"""Stands for a code if the wrong samples are left out, and a note of the recording reports it."""

SIGN, SWAPPED, ERROR = ('sign_suspect', 'cylinders_swapped'), ('cylinders_swapped', 'setpoint_suspect'), ('error',)


def _of_both() -> Iterator[Mistake]:
    """Yield mistakes with two cylinders, of the tutorial's table and of the rig's."""
    for on in ('tutorial', 'rig'):
        yield Mistake(on, 'mm or inch read as m', entries(displacement__unit='m'), UNIT)
        yield Mistake(on, 'everything in bar', every('unit', 'bar', *PRESSURES, *SETPOINTS), UNIT)
        yield Mistake(on, 'everything in Pa', every('unit', 'Pa', *PRESSURES, *SETPOINTS), (*UNIT, *REFERENCE))
        yield Mistake(on, 'one pressure in bar', entries(cylinder_a__pressure__unit='bar'), UNIT)
        yield Mistake(on, 'set-points absolute', every('reference', 'absolute', *SETPOINTS), REFERENCE)
        swapped = columns_of(cylinder_a__pressure='setA', cylinder_a__setpoint='pA')
        yield Mistake(on, 'pressure and set-point swapped', swapped, SETPOINT)
        yield Mistake(on, "the other's set-point", columns_of(cylinder_a__setpoint='setB'), SETPOINT)
        crossed = columns_of(cylinder_a__setpoint='setB', cylinder_b__setpoint='setA')
        yield Mistake(on, 'set-points swapped', crossed, SWAPPED)
        crossed = columns_of(cylinder_a__pressure='pB', cylinder_b__pressure='pA')
        yield Mistake(on, 'pressures swapped', crossed, SWAPPED)
        both = {'cylinder_a__pressure': 'pB', 'cylinder_b__pressure': 'pA'}
        both |= {'cylinder_a__setpoint': 'setB', 'cylinder_b__setpoint': 'setA'}
        yield Mistake(on, 'cylinders swapped', columns_of(**both), SIGN)
        yield Mistake(on, 'displacement the other way', entries(displacement__sign=-1), SIGN)
        yield Mistake(on, 'no set-points', without(*SETPOINTS), ('setpoint_assumed',))
        yield Mistake(on, 'upside down', rows(lambda _: slice(None, None, -1)), ERROR)
        yield Mistake(on, 'the same twice', entries(), ('duplicate_recording',), twice=True)
        yield Mistake(on, 'another device from two thirds on', other_device, ('changed_during_recording',))
        yield Mistake(on, 'a loose plug', loose_plug, (*SAMPLES, LEFT_OUT))
        yield Mistake(on, 'a sensor at its limit', out_of_range, SAMPLES)
        yield Mistake(on, 'a logger that hangs', stuck, SAMPLES)
        yield Mistake(on, 'every fortieth row', rows(lambda _: slice(None, None, 40)), ('sampling_slow',))


def _of_one() -> Iterator[Mistake]:
    """Yield mistakes that one of the tables allows."""
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
    yield Mistake('real', 'everything absolute, read as gauge', counted_from_nothing, REFERENCE)
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
    """Yield mistakes with a measured run."""
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


MISTAKES = (*_of_both(), *_of_one(), *_of_measured())


WORDS = {
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
"""What an error says instead of a code."""


@dataclass(frozen=True)
class Answer:
    """
    What is said of a mistake.

    Attributes
    ----------
    codes
        Of the warnings; `error` where nothing is identified.
    text
        The warning that belongs to the mistake, or else the first; or the error.
    confident
        Channels whose verdict is none that may be wrong.

    """

    codes: tuple[str, ...]
    text: str
    confident: tuple[str, ...]


def answer(mistake: Mistake) -> Answer:
    """Return what the program says of a mistake."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        table, mapping = TABLES[mistake.on]().written(folder, mistake.change)
        given = [str(table)] * (2 if mistake.twice else 1)
        arguments = [*given, '--mapping', str(mapping), '--close-loop', '--output', str(folder / 'out')]
        with redirect_stdout(io.StringIO()), redirect_stderr(io.StringIO()) as errors:
            done = identify_bag([*arguments, *mistake.arguments])
        if done:
            return Answer(('error',), errors.getvalue().strip().replace(f'{folder}/', ''), ())
        report = json.loads((folder / 'out' / 'report.json').read_text(encoding='utf-8'))
    channels = {**report['cylinders'], **({'force': report['force']} if 'force' in report else {})}
    confident = [one for one, own in channels.items() if own['verdict'] in SURE and own['status'] == 'confirmed']
    warnings = [one for one in report['warnings'] if one['level'] == WARNING]
    first = next((one for one in warnings if one['code'] in mistake.codes), warnings[0] if warnings else None)
    text = f'{first["message"]}: {first["fix"]}' if first else ''
    codes = [one['code'] for one in warnings]
    notes = [note for one in report['recordings'] for note in one['notes'] if LEFT_OUT in note]
    if notes and LEFT_OUT in mistake.codes:
        codes, text = [*codes, LEFT_OUT], text or notes[0]
    return Answer(tuple(dict.fromkeys(codes)), text, tuple(confident))


def is_told(mistake: Mistake, said: Answer) -> bool:
    """Return whether a mistake is noticed, and nothing is claimed; without the wrong samples a verdict may be sure."""
    if 'error' in said.codes:
        return any(WORDS[code] in said.text for code in mistake.codes)
    if LEFT_OUT in said.codes:
        return True
    return not said.confident and bool({*said.codes} & {*mistake.codes})


def warnings_of_clean(seed: int) -> list[str]:
    """Return the warnings that a recording of the rig raises which is read as it should be."""
    rng = np.random.default_rng(seed)
    kind: Callable[..., Schedule] = (surface_following, out_and_back, paper_step)[rng.integers(3)]
    device = ('paper', 'real')[rng.integers(2)]
    levels = {'setpoint': float(rng.uniform(3e4, 1.1e5)), 'setpoint_b': float(rng.uniform(3e4, 1.1e5))}
    length = {'duration': 20.0, 'seed': seed} if kind is surface_following else {}
    schedule = kind(**levels, amplitude=float(rng.uniform(0.4e-3, 1.2e-3)), **length)
    recording = recording_of(record(schedule, device_named(device, ''), seed=seed))
    found = identify([recording], Options(close_loop=True))
    return [f'seed {seed}, {device}, {schedule.name}: {one}' for one in found.notices if one.level == WARNING]


def warnings_of_all_clean() -> list[str]:
    """Return the warnings that the clean recordings raise."""
    return [one for some in side_by_side(warnings_of_clean, CLEAN, 'clean recordings') for one in some]


def document(answers: Sequence[tuple[Mistake, Answer]], clean: Sequence[str], notes: str) -> str:
    """Return the table of mistakes with what is said of each, and what clean recordings raise."""
    told = sum(is_told(mistake, said) for mistake, said in answers)
    lines = [(one.on, one.what, ', '.join(said.codes), said.text) for one, said in answers]
    counts = Counter(code for _, said in answers for code in said.codes)
    return '\n'.join(
        [
            '# Mistakes',
            '',
            'What `identify_bag` says of data that were read wrongly. Written by `make mistakes`; what stands under '
            '"Notes" at the end is kept.',
            '',
            '- `tutorial`: the table of the tutorial, psi above ambient, a dead band. `rig`: absolute kPa, inches, a '
            'load cell, a leak. `real`: a healthy device of full physics, bar above ambient. `measured`: a measured '
            f'run of one cylinder, `{MEASURED.stem}`.',
            f'- {len(answers)} mistakes. Of {told} it is said what leads to the mend, and no verdict is confident.',
            f'- Codes: {", ".join(f"`{code}` {count}" for code, count in counts.most_common())}. `error`: nothing is '
            'identified, exit code 2.',
            f'- Of {len(CLEAN)} clean recordings of the rig (seeds {CLEAN[0]} to {CLEAN[-1]}; the devices `paper` and '
            f'`real`, three schedules, levels and strokes drawn) {len(clean)} warnings are raised.',
            *(f'  - {one}' for one in clean),
            f'- Machine: {machine()}',
            '',
            table(('of', 'mistake', 'code', 'what is said first'), lines),
            '',
            notes,
        ]
    )


def main(arguments: Sequence[str] | None = None) -> int:
    """Make each mistake, write the document; return 1 where one is not noticed."""
    parser = argparse.ArgumentParser(prog='mistakes', description=__doc__.split('\n\n')[0])
    parser.add_argument('--output', type=Path, default=ROOT / 'docs' / 'mistakes.md', help='document')
    options = parser.parse_args(arguments)
    answers = []
    for mistake in MISTAKES:
        answers.append((mistake, answer(mistake)))
        print(f'{"told  " if is_told(*answers[-1]) else "MISSED"}  {mistake.on}: {mistake.what}: {answers[-1][1].text}')
    clean = warnings_of_all_clean()
    write_text(options.output, document(answers, clean, notes_in(options.output)))
    return 0 if all(is_told(*one) for one in answers) and not clean else 1


if __name__ == '__main__':
    sys.exit(main())
