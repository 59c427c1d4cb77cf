# SPDX-License-Identifier: Apache-2.0
"""Numba's compile cache, in folders to which nobody else can write, with files that are checked before their use."""

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
    The cache of a compiled function.

    Numba's own ends the program if a file is damaged or the disk is full. Here the function is compiled instead, in
    memory if its code cannot be kept. Where it is kept is decided at its first call.
    """

    def __init__(self, function: Callable[..., Any]) -> None:
        self._function = function

    @lazy_property
    def _kept(self) -> _KeptCode | None:
        try:
            return _KeptCode(self._function)
        except RuntimeError:  # Numba's, if no folder can be used
            return None

    @property
    def cache_path(self) -> str | None:
        """Folder in which the code is kept, or None if there is none."""
        return None if self._kept is None else self._kept.cache_path

    def load_overload(self, signature: Any, context: Any) -> Any:
        """Return the code that is kept for a signature, or None."""
        if self._kept is None:
            return None
        rtsys.initialize(context)  # Numba initializes also what only compiling needs, which takes an eighth of a second
        try:
            return self._kept._load_overload(signature, context)
        except Exception as error:  # unpickling may raise anything
            code_files.report_damage(Path(self._kept.cache_path), f'{type(error).__name__}: {error}')
            return None

    def save_overload(self, signature: Any, result: Any) -> None:
        """Keep the code of a signature; warn once if that is impossible."""
        if self._kept is None:
            _report_memory('no folder can be written')
            return
        try:
            self._kept._save_overload(signature, result)
        except OSError as error:
            _report_memory(f'{self._kept.cache_path}: {error.strerror or error}')


def _report_memory(reason: str) -> None:
    if not code_files.has_warned('untrusted'):
        code_files.warn_once(
            'memory',
            f'Machine code cannot be kept: {reason}. The program compiles it in memory, at each start. Make room, or '
            'name a folder for it in NUMBA_CACHE_DIR.',
        )


def _trusted(locator: Any) -> Any:
    """Return a class of Numba's that looks for a folder, and finds only one that is trusted."""

    class Trusted(locator):  # type: ignore[misc]
        def ensure_cache_path(self) -> None:
            folder = Path(self.get_cache_path())
            code_files.make_folder(folder)
            if not code_files.is_trusted(folder):
                raise PermissionError
            super().ensure_cache_path()

    return Trusted


_Places: Any = FunctionCache._impl_class


class _TrustedPlaces(_Places):  # type: ignore[misc]
    """The kinds of places in which Numba looks for a folder, in its order."""

    _locator_classes = tuple(map(_trusted, _Places._locator_classes))


class _KeptCode(FunctionCache):
    """Numba's cache, in a folder that is trusted."""

    _impl_class = _TrustedPlaces

    def __init__(self, function: Callable[..., Any]) -> None:
        super().__init__(function)
        folder = Path(self.cache_path)
        if not code_files.is_trusted(folder):  # Numba's environment variables may name a kind of place of their own
            raise RuntimeError
        files: Any = _Files(folder, self._impl.filename_base, self._impl.locator.get_source_stamp())
        self._cache_file = files


class _Files:
    """
    One file for each signature of a function.

    Numba has an index beside its files. If a program is killed between writing the two, the index may name a file with
    code of earlier source.
    """

    def __init__(self, folder: Path, name: str, stamp: object) -> None:
        """Keep code in a folder, below a name, for a source file that has a stamp."""
        self._folder = folder
        self._name = name
        self._stamp = stamp

    def load(self, key: object) -> Any:
        """Return what is kept for a key, or None."""
        content = code_files.read(self._path(key))
        if content is None or content[:_HASH] != self._version(key):
            return None
        return pickle.loads(content[_HASH:])

    def save(self, key: object, data: Any) -> None:
        """Keep data for a key; raise OSError if that is impossible."""
        code_files.write(self._path(key), self._version(key) + dumps(data))

    def _path(self, key: object) -> Path:
        return self._folder / f'{self._name}.{_hash(key).hex()[:16]}.nbc'

    def _version(self, key: object) -> bytes:
        """Return what changes with Numba, the source and the key."""
        return _hash((numba.__version__, self._stamp, key))


def _hash(value: object) -> bytes:
    return hashlib.sha256(repr(value).encode()).digest()
