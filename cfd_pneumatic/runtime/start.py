# SPDX-License-Identifier: Apache-2.0
"""
Start of every program: print its help or version without imports, or import and run the program.

The help is a file in `help/`, which `make interface-document` writes from the parsers and nodes.
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
_COLLECTION_THRESHOLD = 50_000  # new objects between garbage collections; late imports make five times as many


def print_help_or_version(program: str, arguments: Iterable[str]) -> bool:
    """Print a program's help or version if its arguments request it; return whether they do."""
    options = set(takewhile(lambda argument: argument != '--', arguments))  # a file name after `--` may be any text
    if options & {'-h', '--help'}:
        text = (HELP / f'{program}.txt').read_text(encoding='utf-8')
    elif '--version' in options:
        text = f'{program} {__version__}\n'
    else:
        return False
    try:
        sys.stdout.write(text)
        sys.stdout.flush()
    except OSError:  # the reader has closed the pipe, or the disk is full
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)  # prevents a second error when Python flushes
    return True


def _run_program(module: str) -> int:
    """Run the program of a module and return its exit code; a signal during its imports ends the process at once."""
    _open_streams()
    name = module.rpartition('.')[2]
    if print_help_or_version(name, sys.argv[1:]):
        return 0
    if reason := _start_error():
        print(f'{name}: error: {reason}', file=sys.stderr)
        return BAD_INPUT
    _drop_relative_entries()
    is_node = module.startswith(_NODES)
    signal.signal(signal.SIGINT, lambda *_: os._exit(0 if is_node else INTERRUPTED))
    if is_node:
        signal.signal(signal.SIGTERM, lambda *_: os._exit(0))
    main = _import_uncollected(module).main
    if not is_node:
        for number in (signal.SIGINT, signal.SIGTERM):  # which ends the program like Ctrl-C, without half a result
            signal.signal(number, signal.default_int_handler)
        gc.set_threshold(_COLLECTION_THRESHOLD)
    code: int = main()
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the program is finished
    if is_node:
        _exit_at_once(code)
    gc.freeze()  # skips the last collection, which takes 0.15 s
    return code


def _exit_at_once(code: int) -> NoReturn:
    """End the process without finalising the interpreter, since threads of ROS may still run."""
    atexit._run_exitfuncs()
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(code)


def _open_streams() -> None:
    """Open missing standard streams to the null device; otherwise a file could get their number and their output."""
    for name in ('stdin', 'stdout', 'stderr'):
        if getattr(sys, name) is None:
            stream = open(os.devnull, 'r' if name == 'stdin' else 'w', encoding='utf-8')  # noqa: SIM115  # stays open
            setattr(sys, name, stream)


def _start_error() -> str:
    """Return a message on why the program cannot run in this environment; '' if it can."""
    try:
        os.getcwd()
    except FileNotFoundError:
        return 'the working folder does not exist any more: change to another folder'
    if os.path.lexists('.numba_config.yaml'):
        return 'the working folder holds .numba_config.yaml, which Numba would use: change to another folder'
    for profiles in _DDS_PROFILES:
        if os.path.lexists(profiles) and not os.path.isfile(profiles):
            return f'{profiles} in the working folder is not a file, and DDS would wait for it: remove it'
    if os.environ.get('NUMBA_DISABLE_JIT', '0') != '0':
        return 'NUMBA_DISABLE_JIT is set, but the model runs only compiled: unset it'
    return ''


def absolute_python_path() -> str:
    """
    Return the absolute entries of PYTHONPATH; those of ROS 2 are absolute.

    A relative entry depends on the working folder. An empty entry, as in `PYTHONPATH=:/opt/ros`, is the working folder:
    Python would run a file named `numpy.py` there.
    """
    return os.pathsep.join(filter(os.path.isabs, os.environ.get('PYTHONPATH', '').split(os.pathsep)))


def _drop_relative_entries() -> None:
    """Remove the relative entries of PYTHONPATH from the import path of this process and of its children."""
    python_path, absolute = os.environ.get('PYTHONPATH', ''), absolute_python_path()
    if python_path == absolute:
        return
    relative = {os.path.abspath(entry) for entry in python_path.split(os.pathsep) if not os.path.isabs(entry)}
    kept = {*absolute.split(os.pathsep), str(Path(__file__).parents[2])}
    sys.path[:] = [folder for folder in sys.path if folder not in relative - kept]
    os.environ['PYTHONPATH'] = absolute


def _import_uncollected(module: str) -> ModuleType:
    """Import a module, and exclude the objects of its import from garbage collection."""
    gc.disable()
    try:
        return import_module(module)
    finally:
        gc.freeze()
        gc.enable()


compile_kernels = partial(_run_program, 'cfd_pneumatic.commands.compile_kernels')
csv_to_bag = partial(_run_program, 'cfd_pneumatic.commands.csv_to_bag')
dask_certificate = partial(_run_program, 'cfd_pneumatic.commands.dask_certificate')
force_on_path = partial(_run_program, 'cfd_pneumatic.commands.force_on_path')
identify_bag = partial(_run_program, 'cfd_pneumatic.commands.identify_bag')
leak_test = partial(_run_program, 'cfd_pneumatic.commands.leak_test')
plan_experiment = partial(_run_program, 'cfd_pneumatic.commands.plan_experiment')
record_rig = partial(_run_program, 'cfd_pneumatic.commands.record_rig')
identifier_node = partial(_run_program, 'cfd_pneumatic.nodes.identifier_node')
monitor_node = partial(_run_program, 'cfd_pneumatic.nodes.monitor_node')
recorder_node = partial(_run_program, 'cfd_pneumatic.nodes.recorder_node')
rig_node = partial(_run_program, 'cfd_pneumatic.nodes.rig_node')
sim_node = partial(_run_program, 'cfd_pneumatic.nodes.sim_node')
