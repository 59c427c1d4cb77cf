# SPDX-License-Identifier: Apache-2.0
"""`dask_certificate`: make a certificate that protects a Dask cluster, for `identify_bag --each` on many computers."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from functools import partial
from pathlib import Path

from cfd_pneumatic.commands import program
from cfd_pneumatic.errors import InputError

NAME = 'dask_certificate'


def write_certificate(arguments: Sequence[str] | None = None) -> None:
    """Write the certificate and print the commands that use it."""
    options = make_parser().parse_args(arguments)
    folder = options.folder
    try:
        from cfd_pneumatic.plant import CERTIFICATE, DAYS, KEY, make_certificate
    except ModuleNotFoundError as error:
        raise InputError(f"it needs Dask ({error.name}): pip install 'cfd_pneumatic[plant]'") from error
    make_certificate(folder, overwrite=options.overwrite)
    files = f'--tls-ca-file {folder / CERTIFICATE} --tls-cert {folder / CERTIFICATE} --tls-key {folder / KEY}'
    print(f'{folder}: valid for {DAYS} days. Copy it to every computer of the cluster, then:')
    print(f'  dask scheduler --protocol tls {files}')
    print(f'  dask worker tls://SCHEDULER:8786 --nworkers=-1 --nthreads=1 {files}')
    print(f'  identify_bag ... --each --scheduler tls://SCHEDULER:8786 --certificate {folder}')


def make_parser() -> argparse.ArgumentParser:
    """Return the parser of the program's arguments."""
    parser = program.parser_of(
        NAME,
        'Make a certificate for a Dask cluster. Scheduler, workers and clients with this certificate refuse all '
        'others. Needs the extra plant.',
    )
    parser.add_argument('folder', type=Path, help='folder for the certificate and its key, which give access')
    parser.add_argument('--overwrite', action='store_true', help='replace an existing certificate')
    return parser


main = partial(program.run, NAME, write_certificate)

if __name__ == '__main__':
    sys.exit(main())
