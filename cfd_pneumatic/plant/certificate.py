# SPDX-License-Identifier: Apache-2.0
"""The certificate by which scheduler, workers and clients of a Dask cluster know each other: one for all of them."""

from __future__ import annotations

import os
from pathlib import Path

from distributed.security import Security

from cfd_pneumatic.errors import InputError
from cfd_pneumatic.input_files import read_input

CERTIFICATE, KEY = 'dask.pem', 'dask.key'
DAYS = 365
"""So long Dask makes them valid."""

_LARGEST = 2**16  # bytes


def make_certificate(folder: Path) -> None:
    """
    Write a certificate and its key, which the owner alone may read.

    Raises
    ------
    InputError
        If there is one already.

    """
    if any((folder / name).exists() for name in (CERTIFICATE, KEY)):
        raise InputError(f'{folder} holds a certificate already: give another folder, or take it away')
    made = Security.temporary()  # type: ignore[no-untyped-call]
    folder.mkdir(parents=True, exist_ok=True)
    for name, content in ((CERTIFICATE, made.tls_client_cert), (KEY, made.tls_client_key)):
        file = os.open(folder / name, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
        with os.fdopen(file, 'w', encoding='ascii') as stream:
            stream.write(content)


def security_of(folder: Path) -> Security:
    """
    Return what a client needs to be let in, and to talk to nobody who poses as the scheduler.

    Raises
    ------
    InputError
        If the folder holds no certificate.

    """
    certificate, key = str(folder / CERTIFICATE), str(folder / KEY)
    for file in (certificate, key):
        try:
            read_input(Path(file), _LARGEST)
        except InputError as error:
            raise InputError(f'{file} {error}: dask_certificate {folder} makes it') from error
    return Security(  # type: ignore[no-untyped-call]
        require_encryption=True, tls_ca_file=certificate, tls_client_cert=certificate, tls_client_key=key
    )
