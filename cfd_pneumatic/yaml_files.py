"""
Reading the YAML files that people write, mappings and parameter files, and bounding those that libraries read.

This is the only door through which YAML comes in. It makes plain values only, and what it makes is bounded by the bytes
of the file: an alias may not unfold to more.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import yaml

from cfd_pneumatic.errors import InputError

LARGEST = 256 * 1024
"""Bytes of a file; what people write has a hundredth of that."""

MOST_NODES = 50_000
"""Keys, values and lists of a file, with all its aliases unfolded."""


def read_yaml(path: Path) -> Any:
    """
    Return what a YAML file holds.

    Raises
    ------
    InputError
        If the file can't be read, is not YAML, is too large or unfolds to too much, or holds a key twice.

    """
    try:
        with path.open('rb') as file:
            content = file.read(LARGEST + 1)
        if len(content) > LARGEST:
            raise InputError(f'has more than {LARGEST // 1024} KiB: is it a file of settings?')
        return _loaded(content.decode('utf-8-sig'))
    except OSError as error:
        raise InputError(f'cannot read {path}: {error.strerror}') from error
    except InputError as error:
        raise InputError(f'{path}: {error}') from error
    except RecursionError as error:
        raise InputError(f'{path}: is nested too deeply') from error
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise InputError(f'{path} is not YAML: {" ".join(str(error).split())}') from error
    except (ValueError, OverflowError) as error:  # a date that is none, a number of thousands of digits
        raise InputError(f'{path}: holds a value that can not be read: {error}') from error


class _Loader(yaml.SafeLoader):
    """Makes plain values only, and no number that is longer than a processor's."""

    def construct_yaml_int(self, node: yaml.ScalarNode) -> int:
        value: int = super().construct_yaml_int(node)
        if not -(2**63) <= value < 2**63:
            raise InputError(f'line {node.start_mark.line + 1}: a number is too large')
        return value


_Loader.add_constructor('tag:yaml.org,2002:int', _Loader.construct_yaml_int)


def _loaded(text: str) -> Any:
    loader = _Loader(text)
    try:
        node = loader.get_single_node()
        if node is None:
            return None
        check_unfolding(node)
        return loader.construct_document(node)
    finally:
        loader.dispose()


def check_unfolding(node: Any) -> None:
    """Raise InputError where a node, of PyYAML or its kin, unfolds to too much or holds a key twice."""
    if _unfolded(node, {}) > MOST_NODES:
        raise InputError(f'unfolds to more than {MOST_NODES:,} values: write out what is needed, without aliases')


def _unfolded(node: Any, sizes: dict[int, int]) -> int:
    """Return how many values a node unfolds to; refuse a key that is there twice, of which PyYAML takes the last."""
    if id(node) not in sizes:
        sizes[id(node)] = MOST_NODES + 1  # while it is counted: an alias that holds itself has no end
        children = list(node.value) if node.id == 'sequence' else []
        if node.id == 'mapping':
            _refuse_twins(node)
            children = [one for pair in node.value for one in pair]
        sizes[id(node)] = min(1 + sum(_unfolded(one, sizes) for one in children), MOST_NODES + 1)
    return sizes[id(node)]


def _refuse_twins(node: Any) -> None:
    lines: dict[tuple[str, str], int] = {}
    for key, _ in node.value:
        if key.id == 'scalar':
            name, line = (str(key.tag), key.value), key.start_mark.line + 1
            if name in lines:
                raise InputError(
                    f'line {line}: the key {key.value!r} stands in line {lines[name]} already: leave one out'
                )
            lines[name] = line
