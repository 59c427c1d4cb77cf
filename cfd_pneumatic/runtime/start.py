# SPDX-License-Identifier: Apache-2.0
"""
Where every program begins: its help and its version at once, itself where more is asked.

Help is a page in `help/`, which `make interface-document` writes of what parsers and nodes say of themselves. Nothing
has to be imported for it.
"""

from __future__ import annotations

import atexit
import gc
import os
import signal
import sys
from collections.abc import Iterable
from functools import partial
from importlib import import_module
from itertools import takewhile
from pathlib import Path
from types import ModuleType
from typing import NoReturn

from cfd_pneumatic import __version__

HELP = Path(__file__).parents[1] / 'help'
BAD_INPUT = 2
INTERRUPTED = 130
_NODES = 'cfd_pneumatic.nodes.'
_DDS_PROFILES = ('DEFAULT_FASTRTPS_PROFILES.xml', 'DEFAULT_FASTDDS_PROFILES.xml')  # read from the working folder
_MUCH = 50_000  # objects made, after which a command looks for garbage: its late imports alone make five times as many


def print_help_or_version(program: str, arguments: Iterable[str]) -> bool:
    """Print a program's help or version where its arguments ask for one, and return whether they did."""
    options = set(takewhile(lambda one: one != '--', arguments))  # behind it a file may have any name
    if options & {'-h', '--help'}:
        text = (HELP / f'{program}.txt').read_text(encoding='utf-8')
    elif '--version' in options:
        text = f'{program} {__version__}\n'
    else:
        return False
    try:
        sys.stdout.write(text)
        sys.stdout.flush()
    except OSError:  # whoever asked has gone, or the disk is full
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)  # or Python complains again when it flushes
    return True


def _begin(module: str) -> int:
    """Run the program that is a module, and return its exit code; a signal ends its imports at once."""
    _open_streams()
    name = module.rpartition('.')[2]
    if print_help_or_version(name, sys.argv[1:]):
        return 0
    if reason := _obstacle():
        print(f'{name}: error: {reason}', file=sys.stderr)
        return BAD_INPUT
    _leave_relative_entries()
    is_node = module.startswith(_NODES)
    signal.signal(signal.SIGINT, lambda *_: os._exit(0 if is_node else INTERRUPTED))
    if is_node:
        signal.signal(signal.SIGTERM, lambda *_: os._exit(0))
    main = _imported(module).main
    if not is_node:
        signal.signal(signal.SIGINT, signal.default_int_handler)
        gc.set_threshold(_MUCH)
    code: int = main()
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # all is done
    if is_node:
        _leave(code)
    gc.freeze()  # the process ends: a last collection takes 0.15 s
    return code


def _leave(code: int) -> NoReturn:
    """End the process without taking the interpreter apart, while threads of ROS may still run in it."""
    atexit._run_exitfuncs()
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(code)


def _open_streams() -> None:
    """Open to nowhere what the program was started without; else a file would get its number, and be printed into."""
    for name in ('stdin', 'stdout', 'stderr'):
        if getattr(sys, name) is None:
            stream = open(os.devnull, 'r' if name == 'stdin' else 'w', encoding='utf-8')  # noqa: SIM115  # stays open
            setattr(sys, name, stream)


def _obstacle() -> str:
    """Return why nothing can run here, or nothing."""
    try:
        os.getcwd()
    except FileNotFoundError:
        return 'the folder in which it was started is gone: change to another'
    if os.path.lexists('.numba_config.yaml'):
        return 'the folder in which it was started holds .numba_config.yaml, which Numba would obey: change to another'
    for profiles in _DDS_PROFILES:
        if os.path.lexists(profiles) and not os.path.isfile(profiles):
            return f'{profiles} in the folder in which it was started is not a file: DDS would wait for it; remove it'
    if os.environ.get('NUMBA_DISABLE_JIT', '0') != '0':
        return 'NUMBA_DISABLE_JIT is set, and the model runs compiled only: unset it'
    return ''


def absolute_python_path() -> str:
    """
    Return the entries of PYTHONPATH that are absolute, as those of ROS 2 are.

    Others name another folder wherever a program is started. An empty one, as in `PYTHONPATH=:/opt/ros`, is the working
    folder, in which a file named `numpy.py` would be run.
    """
    return os.pathsep.join(filter(os.path.isabs, os.environ.get('PYTHONPATH', '').split(os.pathsep)))


def _leave_relative_entries() -> None:
    """Import nothing more from folders that only relative entries of PYTHONPATH name; nor do later children."""
    given, absolute = os.environ.get('PYTHONPATH', ''), absolute_python_path()
    if given == absolute:
        return
    relative = {os.path.abspath(entry) for entry in given.split(os.pathsep) if not os.path.isabs(entry)}
    kept = {*absolute.split(os.pathsep), str(Path(__file__).parents[2])}
    sys.path[:] = [folder for folder in sys.path if folder not in relative - kept]
    os.environ['PYTHONPATH'] = absolute


def _imported(module: str) -> ModuleType:
    """Return an imported module; what its import made stays, and no collection looks for garbage there."""
    gc.disable()
    try:
        return import_module(module)
    finally:
        gc.freeze()
        gc.enable()


compile_kernels = partial(_begin, 'cfd_pneumatic.commands.compile_kernels')
csv_to_bag = partial(_begin, 'cfd_pneumatic.commands.csv_to_bag')
dask_certificate = partial(_begin, 'cfd_pneumatic.commands.dask_certificate')
identify_bag = partial(_begin, 'cfd_pneumatic.commands.identify_bag')
leak_test = partial(_begin, 'cfd_pneumatic.commands.leak_test')
plan_experiment = partial(_begin, 'cfd_pneumatic.commands.plan_experiment')
record_rig = partial(_begin, 'cfd_pneumatic.commands.record_rig')
identifier_node = partial(_begin, 'cfd_pneumatic.nodes.identifier_node')
monitor_node = partial(_begin, 'cfd_pneumatic.nodes.monitor_node')
recorder_node = partial(_begin, 'cfd_pneumatic.nodes.recorder_node')
rig_node = partial(_begin, 'cfd_pneumatic.nodes.rig_node')
sim_node = partial(_begin, 'cfd_pneumatic.nodes.sim_node')
