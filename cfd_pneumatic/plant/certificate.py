# SPDX-License-Identifier: Apache-2.0
"""The certificate by which scheduler, workers and clients of a Dask cluster know each other: one for all of them."""

from __future__ import annotations

import os
import ssl
from pathlib import Path

from distributed.security import Security

from cfd_pneumatic.errors import InputError
from cfd_pneumatic.files import ResultFiles, never, read_input

CERTIFICATE, KEY = 'dask.pem', 'dask.key'
DAYS = 365
"""So long Dask makes them valid."""

_LARGEST = 2**16  # bytes


FILES = ResultFiles({KEY: never, CERTIFICATE: never})
"""An earlier certificate is not replaced unasked: a cluster may use it."""


def make_certificate(folder: Path, *, overwrite: bool = False) -> None:
    """
    Write a certificate and its key, which the owner alone may read.

    Parameters
    ----------
    folder
        Where to; made if need be.
    overwrite
        Whether an earlier certificate is replaced.

    Raises
    ------
    InputError
        If there is one already, or the folder can't be written.

    """
    FILES.check(folder, overwrite=overwrite)
    made = Security.temporary()  # type: ignore[no-untyped-call]
    with FILES.made_for(folder, overwrite=overwrite) as aside:
        for name, content in ((CERTIFICATE, made.tls_client_cert), (KEY, made.tls_client_key)):
            file = os.open(aside / name, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
            with os.fdopen(file, 'w', encoding='ascii') as stream:
                stream.write(content)


def security_of(folder: Path) -> Security:
    """
    Return what a client needs to be let in, and to talk to nobody who poses as the scheduler.

    Raises
    ------
    InputError
        If the folder holds no certificate, or its key has a passphrase.

    """
    certificate, key = str(folder / CERTIFICATE), str(folder / KEY)
    for file in (certificate, key):
        try:
            read_input(Path(file), _LARGEST)
        except InputError as error:
            raise InputError(f'{file} {error}: dask_certificate {folder} makes it') from error
    try:  # before Dask does, which would ask for a passphrase and leave an error of OpenSSL to its caller
        ssl.create_default_context(cafile=certificate).load_cert_chain(certificate, key, password=lambda: '')
    except (ssl.SSLError, ValueError) as error:
        raise InputError(
            f'{certificate} and {key} are not a certificate and its key without a passphrase: '
            f'dask_certificate {folder} makes them'
        ) from error
    return Security(  # type: ignore[no-untyped-call]
        require_encryption=True, tls_ca_file=certificate, tls_client_cert=certificate, tls_client_key=key
    )
