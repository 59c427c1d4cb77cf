# SPDX-License-Identifier: Apache-2.0
"""Numba's compile cache, in folders without write permission for other users, with checksums of its files."""

from __future__ import annotations

import hashlib
import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numba
from numba.core.caching import FunctionCache, NullCache
from numba.core.runtime.nrt import rtsys
from numba.core.serialize import dumps

from cfd_pneumatic.lazy import lazy_property
from cfd_pneumatic.runtime import code_files

_HASH = hashlib.sha256().digest_size  # [bytes]


class CompileCache(NullCache):
    """
    Cache of a compiled function.

    Numba's cache ends the program if a file is damaged or the disk is full. This cache lets Numba compile the function
    instead, in memory if the code cannot be kept. The first call of the function selects the folder.
    """

    def __init__(self, function: Callable[..., Any]) -> None:
        self._function = function

    @lazy_property
    def _kept(self) -> _KeptCode | None:
        try:
            return _KeptCode(self._function)
        except RuntimeError:  # from Numba, if no folder can be used
            return None

    @property
    def cache_path(self) -> str | None:
        """Folder in which the code is kept; None if no folder can be used."""
        return None if self._kept is None else self._kept.cache_path

    def load_overload(self, signature: Any, context: Any) -> Any:
        """Return the kept code of a signature, or None."""
        if self._kept is None:
            return None
        rtsys.initialize(context)  # Numba also initialises the compiler here, which takes 0.12 s and is not needed
        try:
            return self._kept._load_overload(signature, context)
        except Exception as error:  # unpickling may raise anything
            code_files.report_damage(Path(self._kept.cache_path), f'{type(error).__name__}: {error}')
            return None

    def save_overload(self, signature: Any, result: Any) -> None:
        """Keep the code of a signature; warn once if that is impossible."""
        if self._kept is None:
            _warn_not_kept('no folder can be written')
            return
        try:
            self._kept._save_overload(signature, result)
        except OSError as error:
            _warn_not_kept(f'{self._kept.cache_path}: {error.strerror or error}')


def _warn_not_kept(reason: str) -> None:
    if not code_files.has_warned('untrusted'):
        code_files.warn_once(
            'memory',
            f'Machine code cannot be kept: {reason}. The program compiles its functions at each start. Make room, or '
            'name a folder for the code in NUMBA_CACHE_DIR.',
        )


def _trusted(locator: Any) -> Any:
    """Return a Numba locator class that accepts only trusted folders."""

    class Trusted(locator):  # type: ignore[misc]
        def ensure_cache_path(self) -> None:
            folder = Path(self.get_cache_path())
            code_files.make_folder(folder)
            if not code_files.is_trusted(folder):
                raise PermissionError
            super().ensure_cache_path()

    return Trusted


_Locators: Any = FunctionCache._impl_class


class _TrustedLocators(_Locators):  # type: ignore[misc]
    """Numba's locators of cache folders, in Numba's order, restricted to trusted folders."""

    _locator_classes = tuple(map(_trusted, _Locators._locator_classes))


class _KeptCode(FunctionCache):
    """Numba's cache in a trusted folder."""

    _impl_class = _TrustedLocators

    def __init__(self, function: Callable[..., Any]) -> None:
        super().__init__(function)
        folder = Path(self.cache_path)
        if not code_files.is_trusted(folder):  # Numba's environment variables may select another locator
            raise RuntimeError
        files: Any = _SignatureFiles(folder, self._impl.filename_base, self._impl.locator.get_source_stamp())
        self._cache_file = files


class _SignatureFiles:
    """
    Files of code, one for each signature of a function.

    Numba writes an index in addition to its files. If a program is killed between the two, the index may name a file
    with the code of an earlier source.
    """

    def __init__(self, folder: Path, name: str, stamp: object) -> None:
        """Keep code in a folder, in files that begin with a name, for a source file with a stamp."""
        self._folder = folder
        self._name = name
        self._stamp = stamp

    def load(self, key: object) -> Any:
        """Return the data that are kept for a key, or None."""
        content = code_files.read(self._path(key))
        if content is None or content[:_HASH] != self._version(key):
            return None
        return pickle.loads(content[_HASH:])

    def save(self, key: object, data: Any) -> None:
        """Keep data for a key; raise OSError if the file cannot be written."""
        code_files.write(self._path(key), self._version(key) + dumps(data))

    def _path(self, key: object) -> Path:
        return self._folder / f'{self._name}.{_hash(key).hex()[:16]}.nbc'

    def _version(self, key: object) -> bytes:
        """Return a hash of Numba's version, the source's stamp and the key."""
        return _hash((numba.__version__, self._stamp, key))


def _hash(value: object) -> bytes:
    return hashlib.sha256(repr(value).encode()).digest()
