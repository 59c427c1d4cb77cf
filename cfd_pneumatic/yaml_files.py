# SPDX-License-Identifier: Apache-2.0
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
    """Makes plain values only, and no number that is longer than a processor's; an anchor may come twice, as in 1.2."""

    def compose_node(self, parent: yaml.Node | None, index: int) -> yaml.Node | None:
        if not self.check_event(yaml.AliasEvent):
            self.anchors.pop(self.peek_event().anchor, None)  # type: ignore[no-untyped-call]
        return super().compose_node(parent, index)

    def construct_yaml_int(self, node: yaml.ScalarNode) -> int:
        value: int = super().construct_yaml_int(node)
        if not -(2**63) <= value < 2**63:
            raise InputError(f'line {node.start_mark.line + 1}: a number is too large')
        return value


_Loader.add_constructor('tag:yaml.org,2002:int', _Loader.construct_yaml_int)


def check_unfolding(text: str) -> None:
    """Raise InputError where YAML unfolds to too much or holds a key twice, and yaml.YAMLError where it is none."""
    _loaded(text, build=False)


def _loaded(text: str, build: bool = True) -> Any:
    """Return what YAML holds, where it is bounded and to be built."""
    loader = _Loader(text)
    try:
        node = loader.get_single_node()
        if node is not None and _unfolded(node, {}) > MOST_NODES:
            raise InputError(f'unfolds to more than {MOST_NODES:,} values: write out what is needed, without aliases')
        return loader.construct_document(node) if build and node is not None else None
    finally:
        loader.dispose()


def _unfolded(node: yaml.Node, sizes: dict[int, int]) -> int:
    """Return how many values a node unfolds to; refuse a key that is there twice, of which PyYAML takes the last."""
    if id(node) not in sizes:
        sizes[id(node)] = MOST_NODES + 1  # while it is counted: an alias that holds itself has no end
        children = list(node.value) if isinstance(node, yaml.SequenceNode) else []
        if isinstance(node, yaml.MappingNode):
            _refuse_twins(node)
            children = [one for pair in node.value for one in pair]
        sizes[id(node)] = min(1 + sum(_unfolded(one, sizes) for one in children), MOST_NODES + 1)
    return sizes[id(node)]


def _refuse_twins(node: yaml.MappingNode) -> None:
    lines: dict[tuple[str, str], int] = {}
    for key, _ in node.value:
        if isinstance(key, yaml.ScalarNode):
            name, line = (key.tag, key.value), key.start_mark.line + 1
            if name in lines:
                raise InputError(
                    f'line {line}: the key {key.value!r} stands in line {lines[name]} already: leave one out'
                )
            lines[name] = line
