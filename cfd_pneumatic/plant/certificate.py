# SPDX-License-Identifier: Apache-2.0
"""The certificate with which scheduler, workers and clients of a Dask cluster authenticate each other."""

from __future__ import annotations

import os
import ssl
from pathlib import Path

from distributed.security import Security

from cfd_pneumatic.errors import InputError
from cfd_pneumatic.files import ResultFiles, never, read_input

CERTIFICATE, KEY = 'dask.pem', 'dask.key'
DAYS = 365
"""Validity of the certificates that Dask makes [days]."""

_LARGEST = 2**16  # bytes


FILES = ResultFiles({KEY: never, CERTIFICATE: never})
"""Files of the certificate. Earlier files are replaced only on request: a cluster may use them."""


def make_certificate(folder: Path, *, overwrite: bool = False) -> None:
    """
    Write a certificate and its key, which only the owner can read.

    Parameters
    ----------
    folder
        Folder for the files. A missing folder is created.
    overwrite
        Whether an earlier certificate is replaced.

    Raises
    ------
    InputError
        If the folder has a certificate already, or cannot be written.

    """
    FILES.check(folder, overwrite=overwrite)
    temporary = Security.temporary()  # type: ignore[no-untyped-call]
    with FILES.made_for(folder, overwrite=overwrite) as staged_folder:
        for name, content in ((CERTIFICATE, temporary.tls_client_cert), (KEY, temporary.tls_client_key)):
            file = os.open(staged_folder / name, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
            with os.fdopen(file, 'w', encoding='ascii') as stream:
                stream.write(content)


def load_tls(folder: Path) -> Security:
    """
    Return the TLS settings of a client, with which scheduler and client authenticate each other.

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
            raise InputError(f'{file} {error}. Create it with `dask_certificate {folder}`') from error
    try:  # checked before Dask loads the files: Dask would ask for a passphrase and raise errors of OpenSSL
        ssl.create_default_context(cafile=certificate).load_cert_chain(certificate, key, password=lambda: '')
    except (ssl.SSLError, ValueError) as error:
        raise InputError(
            f'{certificate} and {key} must be a certificate and its key without a passphrase. '
            f'Create them with `dask_certificate {folder}`'
        ) from error
    return Security(  # type: ignore[no-untyped-call]
        require_encryption=True, tls_ca_file=certificate, tls_client_cert=certificate, tls_client_key=key
    )
