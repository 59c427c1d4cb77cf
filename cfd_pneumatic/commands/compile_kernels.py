# SPDX-License-Identifier: Apache-2.0
"""`compile_kernels`: what all programs compile on their first start, at once; for the build of an image."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from compileall import compile_dir
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

from cfd_pneumatic.commands import program

NAME = 'compile_kernels'


def compile_all(arguments: Sequence[str] | None = None) -> None:
    """Compile, and say where the machine code is kept."""
    make_parser().parse_args(arguments)
    from cfd_pneumatic.runtime import announced

    told: list[str | None] = []
    waits = False

    def wait() -> None:
        nonlocal waits
        if not waits:
            print('another process compiles: waiting for it', flush=True)
        waits = True

    compile_dir(Path(__file__).parents[1], quiet=2)  # else each start does, where Python may not write, as in images
    with announced(told.append, wait):
        _use_everything()
    if not told:
        print('everything is compiled already')
    elif told[0] is None:
        print('compiled in vain: no cache can be written; name a folder for it in NUMBA_CACHE_DIR')
    else:
        folder = Path(told[0])  # of one module
        below = folder.parent.parent if folder.name == '__pycache__' else folder.parent
        print(f'compiled: the machine code is kept below {below}')


def _use_everything() -> None:
    """Do what the programs do: record, identify, plan, answer live, watch."""
    from cfd_pneumatic import model, monitoring
    from cfd_pneumatic.device import identified_device
    from cfd_pneumatic.identification import Options, identify
    from cfd_pneumatic.planning import Limits, plan
    from cfd_pneumatic.recording import read_recording, recording_of, write_recording
    from cfd_pneumatic.reporting import write_report
    from cfd_pneumatic.rig import device_named, out_and_back, record

    leaking = device_named('paper', 'effects_a.leak_conductance=1e-10')
    with TemporaryDirectory() as name:
        folder = Path(name)
        write_recording(folder / 'bag', recording_of(record(out_and_back(), leaking), 'out_and_back', 0))
        found = identify([read_recording(folder / 'bag')], Options(close_loop=True))
        write_report(found, folder)
    plan(identified_device(found), Limits((35e3, 70e3), duration=5.0), wanted=('k_v',))
    model.warm_up()
    monitoring.warm_up()


def make_parser() -> argparse.ArgumentParser:
    """Return the parser of the program's arguments."""
    return program.parser_of(
        NAME,
        'Compile everything that the programs and nodes would compile on their first start: after an installation, or '
        'in the build of an image. It is kept beside the package, in the cache of the user who gives this command, or '
        'in NUMBA_CACHE_DIR.',
    )


main = partial(program.run, NAME, compile_all)

if __name__ == '__main__':
    sys.exit(main())
