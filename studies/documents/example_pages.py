# SPDX-License-Identifier: Apache-2.0
"""
Write a page of each kind for readers, with screenshots of a desktop and a phone: make example-pages.

    python -m studies.documents.example_pages build/example_pages
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from cfd_pneumatic import Device, Limits, plan
from cfd_pneumatic.commands import identify_bag_main as identify_bag
from cfd_pneumatic.identification import Options, identify
from cfd_pneumatic.plant import Settings, find_bags, local_cluster, survey
from cfd_pneumatic.recording import recording_of, write_recording
from cfd_pneumatic.reporting import write_report
from cfd_pneumatic.rig import device_named, record, surface_following
from studies.panel.same_reports import Case, recording_and_options
from studies.tools.chromium import Chromium
from studies.trials.mistakes import MISTAKES, TABLES

CASES = {
    'found': Case('effects', ('leakage',), 'surface_following', 1000),
    'tie': Case('effects', ('positional_leakage',), 'paper_step', 1001),
    'hypothesis': Case('foreign', ('poppet_inertia',), 'paper_step', 1001),
    'unexplained': Case('foreign', ('set_point_jump',), 'surface_following', 1000),
    'curve': Case('law', ('bulge',), 'surface_following', 7000),
    'nothing_missing': Case('clean', ('white',), 'surface_following', 1000),
    'force': Case('force', ('force_offset',), 'surface_following', 1000),
}
"""Recording of each kind of report with a single part."""

_EPOCH, _DAY = 1_700_000_000_000_000_000, 86_400_000_000_000  # begin of the recordings of a plant, and a day [ns]
_DRAWING = 1.0  # time for plots to appear [s]

SIZES = {'desktop': (1400, 900), 'phone': (390, 844)}
"""Sizes of the screenshots [CSS px]."""


def write_pages(folder: Path) -> dict[str, Path]:
    """Write a page of each kind below a folder; return the pages by kind."""
    pages = {}
    for kind, case in CASES.items():
        recording, options = recording_and_options(case)
        pages[kind] = folder / kind / 'report.html'
        write_report(identify([replace(recording, name=f'press_{kind}')], options), pages[kind].parent, overwrite=True)
    pages['warnings'] = _page_of_misread_table(folder / 'warnings')
    devices = {seed: device_named('real', 'effects_a.leak_conductance=1e-10' if seed == 8 else '') for seed in (7, 8)}
    recordings = [
        recording_of(
            record(surface_following(duration=30.0, seed=seed), device, seed=seed),
            f'shift_{seed}',
            _EPOCH + seed * _DAY,
        )
        for seed, device in devices.items()
    ]
    pages['two_cylinders'] = folder / 'two_cylinders' / 'report.html'
    found = identify(recordings[1:], Options(close_loop=True))
    write_report(found, pages['two_cylinders'].parent, overwrite=True)
    for recording in recordings:
        write_recording(folder / 'bags' / 'cell_1' / recording.name, recording, overwrite=True)
    bags = find_bags([folder / 'bags'], folder / 'plant')
    survey(
        bags, Settings(Options(close_loop=True)), folder / 'plant', local_cluster(1), lambda *_: None, overwrite=True
    )
    pages['plant'] = folder / 'plant' / 'index.html'
    device = Device.load(folder / 'two_cylinders' / 'parameters.yaml')
    planned = plan(device, Limits(pressures=(35e3, 70e3), duration=20.0))
    planned.save(folder / 'plan', overwrite=True)
    pages['plan'] = folder / 'plan' / 'plan.html'
    return pages


def _page_of_misread_table(folder: Path) -> Path:
    """Write the report of a table that is read with a wrong unit."""
    mistake = next(error for error in MISTAKES if (error.table, error.description) == ('tutorial', 'mm read as mil'))
    folder.mkdir(parents=True, exist_ok=True)
    table, mapping = TABLES[mistake.table]().write(folder, mistake.change)
    identify_bag([str(table), '--mapping', str(mapping), '--close-loop', '--overwrite', '--output', str(folder)])
    return folder / 'report.html'


def take_screenshots(pages: dict[str, Path], folder: Path) -> None:
    """Take the first screen of each page in each size."""
    with Chromium() as browser:
        for kind, page in pages.items():
            for name, (width, height) in SIZES.items():
                browser.show(page, width, height)
                time.sleep(_DRAWING)
                (folder / f'{kind}-{name}.png').write_bytes(browser.screenshot())


def main(arguments: Sequence[str] | None = None) -> int:
    """Write the pages and their screenshots; return the exit code."""
    parser = argparse.ArgumentParser(prog='example_pages', description=__doc__.split('\n\n')[0])
    parser.add_argument('folder', type=Path, help='folder for the pages')
    folder = parser.parse_args(arguments).folder
    take_screenshots(write_pages(folder), folder)
    return 0


if __name__ == '__main__':
    sys.exit(main())
