# SPDX-License-Identifier: Apache-2.0
"""`compile_kernels`: compile all machine code of the programs and nodes in advance, for the build of an image."""

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
    """Compile all machine code and print its folder."""
    make_parser().parse_args(arguments)
    from cfd_pneumatic.runtime import announced

    folders: list[str | None] = []
    is_waiting = False

    def wait() -> None:
        nonlocal is_waiting
        if not is_waiting:
            print('another process is compiling: waiting for the end', flush=True)
        is_waiting = True

    compile_dir(Path(__file__).parents[1], quiet=2)  # else each start compiles again in a read-only image
    with announced(folders.append, wait):
        _run_everything()
    if not folders:
        print('everything is compiled already')
    elif folders[0] is None:
        print('The machine code is lost: no cache folder is writable. Set NUMBA_CACHE_DIR to a writable folder.')
    else:
        module_folder = Path(folders[0])
        cache = module_folder.parent.parent if module_folder.name == '__pycache__' else module_folder.parent
        print(f'compiled: the machine code is kept below {cache}')


def _run_everything() -> None:
    """Record, identify, plan, simulate and monitor, so that the code of all programs is compiled."""
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
        identification = identify([read_recording(folder / 'bag')], Options(close_loop=True))
        write_report(identification, folder)
    plan(identified_device(identification), Limits((35e3, 70e3), duration=5.0), wanted=('k_v',))
    model.warm_up()
    monitoring.warm_up()


def make_parser() -> argparse.ArgumentParser:
    """Return the parser of the program's arguments."""
    return program.parser_of(
        NAME,
        'Compile everything that the programs and nodes would compile on their first start. Run it after an '
        'installation, or in the build of an image. The machine code is kept in the folder of the package, in the '
        'cache of the user who runs this command, or in NUMBA_CACHE_DIR.',
    )


main = partial(program.run, NAME, compile_all)

if __name__ == '__main__':
    sys.exit(main())
