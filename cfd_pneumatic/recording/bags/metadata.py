# SPDX-License-Identifier: Apache-2.0
"""`metadata.yaml` of a bag: its files and their compression."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path, PurePath
from typing import Literal, get_args

from cfd_pneumatic.errors import InputError
from cfd_pneumatic.files import read_yaml
from cfd_pneumatic.recording.bags.storages import StorageName

_LARGEST = 2**20  # bytes; a thousand files take a fifth of that
_ROOT = 'rosbag2_bagfile_information'

Compression = Literal['none', 'file', 'message']


@dataclass(frozen=True)
class Metadata:
    """
    Metadata of a bag that the reader needs.

    Attributes
    ----------
    files : tuple of Path
        Files of the bag, in the folder of the metadata.
    storage : StorageName
        Format of the files.
    compression : Compression
        Whether whole files or single messages are compressed with zstd.
    remarks : dict
        Texts by key; `BagWriter.remark` writes them.

    """

    files: tuple[Path, ...]
    storage: StorageName
    compression: Compression
    remarks: Mapping[str, str]


def read_metadata(path: Path) -> Metadata:
    """
    Return the metadata of a bag.

    Raises
    ------
    InputError
        If the metadata cannot be read, or are of an unknown kind.

    """
    try:
        content = read_yaml(path, _LARGEST, texts=True)
    except InputError as error:
        raise InputError(str(error).removeprefix(f'{path}: ')) from error
    try:
        entries = content[_ROOT]
        names = [PurePath(name).name for name in entries['relative_file_paths']]
        storage, compression = entries['storage_identifier'], (entries.get('compression_mode') or 'none').lower()
        packing = entries.get('compression_format')
        custom = entries.get('custom_data')
        remarks = {str(key): str(text) for key, text in custom.items()} if isinstance(custom, dict) else {}
    except (AttributeError, LookupError, TypeError, ValueError) as error:
        raise InputError(f'it lacks {_ROOT} with relative_file_paths and storage_identifier') from error
    for key, value, known in (
        ('storage_identifier', storage, get_args(StorageName)),
        ('compression_mode', compression, get_args(Compression)),
        ('compression_format', packing, ('zstd',) if compression != 'none' else (packing,)),
    ):
        if value not in known:
            raise InputError(f'its {key} is not one of {", ".join(known)}')
    files = tuple(path.parent / name for name in dict.fromkeys(names) if not name.startswith('.'))
    missing = sum(not file.exists() for file in files)
    if missing or not files:
        raise InputError(
            f'{missing} of the {len(files)} files that it names are missing: copy the whole folder of the bag'
        )
    return Metadata(files, storage, compression, remarks)  # type: ignore[arg-type]  # checked above
