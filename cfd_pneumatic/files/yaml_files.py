# SPDX-License-Identifier: Apache-2.0
"""
Reading YAML files: mappings, parameter files, and the metadata of bags.

This is the only door through which YAML comes in. It makes plain values only, and what it makes is bounded by the bytes
of the file: an alias may not unfold to more. Messages name lines and quote nothing: the file may be somebody's secret.
"""

from __future__ import annotations

import re
from collections.abc import Generator
from pathlib import Path
from typing import Any

import yaml

from cfd_pneumatic.errors import InputError
from cfd_pneumatic.files.inputs import read_input

LARGEST = 256 * 1024
"""Bytes of a file that people write; most have a hundredth of that."""

MOST_NODES = 50_000
"""Keys, values and lists of a file, with all its aliases unfolded."""

_QUOTES_NOTHING = re.compile(r"""(?:[^'"]|'(?:\\?.|<[a-z ]+>)')*""")
"""What a message of PyYAML says before it quotes more than a character; `<block end>` is a kind of token."""


class YamlMapping(dict[Any, Any]):
    """
    Keys and values, and where they are.

    Attributes
    ----------
    line : int
        Line of the file in which the mapping begins, from 1 on.
    lines : dict
        Line of each key.

    """

    line: int
    lines: dict[Any, int]


def read_yaml(path: Path, most: int = LARGEST, *, texts: bool = False) -> Any:
    """
    Return what a YAML file holds; its mappings are `YamlMapping`.

    Parameters
    ----------
    path : Path
        The file.
    most : int
        Bytes that it may have.
    texts : bool
        Whether numbers, dates and switches stay as they are written.

    Raises
    ------
    InputError
        If the file can't be read, is not YAML, is too large or unfolds to too much, or holds a key twice.

    """
    try:
        return _loaded(read_input(path, most).decode('utf-8-sig'), texts)
    except InputError as error:
        raise InputError(f'{path}: {error}') from error
    except RecursionError as error:
        raise InputError(f'{path}: is nested too deeply') from error
    except UnicodeDecodeError as error:
        raise InputError(f'{path}: is not YAML: its bytes are not text in UTF-8') from error
    except yaml.YAMLError as error:
        raise InputError(f'{path}: is not YAML: {_problem(error)}') from error


class _Loader(yaml.SafeLoader):
    """Makes plain values only, and no number that is longer than a processor's; an anchor may come twice, as in 1.2."""

    def __init__(self, text: str, texts: bool) -> None:
        super().__init__(text)
        self._nodes = 0
        self._texts = texts

    def resolve(self, kind: type[yaml.Node], value: Any, implicit: Any) -> Any:
        if self._texts and kind is yaml.ScalarNode:
            return self.DEFAULT_SCALAR_TAG
        return super().resolve(kind, value, implicit)  # type: ignore[no-untyped-call]

    def compose_node(self, parent: yaml.Node | None, index: int) -> yaml.Node | None:
        self._nodes += 1
        if self._nodes > MOST_NODES:
            raise InputError(f'has more than {MOST_NODES:,} values: is it a file of settings?')
        if not self.check_event(yaml.AliasEvent):
            self.anchors.pop(self.peek_event().anchor, None)  # type: ignore[no-untyped-call]
        return super().compose_node(parent, index)

    def construct_object(self, node: yaml.Node, deep: bool = False) -> Any:
        try:
            return super().construct_object(node, deep)
        except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as error:
            # a date that is none, a number of thousands of digits, a tag that the value does not fit
            raise InputError(f'line {_line(node)}: holds a value that can not be read') from error

    def construct_yaml_int(self, node: yaml.ScalarNode) -> int:
        value: int = super().construct_yaml_int(node)
        if not -(2**63) <= value < 2**63:
            raise InputError(f'line {_line(node)}: a number is too large')
        return value

    def construct_yaml_map(self, node: yaml.MappingNode) -> Generator[dict[Any, Any], None, None]:
        made = YamlMapping()
        yield made
        made.update(self.construct_mapping(node))
        made.line = _line(node)
        made.lines = {self.construct_object(key, deep=True): _line(key) for key, _ in node.value}


_Loader.add_constructor('tag:yaml.org,2002:int', _Loader.construct_yaml_int)
_Loader.add_constructor('tag:yaml.org,2002:map', _Loader.construct_yaml_map)


def _loaded(text: str, texts: bool) -> Any:
    """Return what YAML holds, where it is bounded."""
    loader = _Loader(text, texts)
    try:
        node = loader.get_single_node()
        if node is not None and _unfolded(node, {}) > MOST_NODES:
            raise InputError(f'unfolds to more than {MOST_NODES:,} values: write out what is needed, without aliases')
        return None if node is None else loader.construct_document(node)
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
            name = key.tag, key.value
            if name in lines:
                raise InputError(f'line {_line(key)}: the key stands in line {lines[name]} already: leave one out')
            lines[name] = _line(key)


def _line(node: yaml.Node) -> int:
    """Return the line in which a node begins, from 1 on."""
    return int(node.start_mark.line) + 1


def _problem(error: yaml.YAMLError) -> str:
    """Return what is wrong with a text that is not YAML, and where, without a word of the text."""
    mark = getattr(error, 'problem_mark', None)
    where = '' if mark is None else f'line {mark.line + 1}, column {mark.column + 1}: '
    texts = (getattr(error, name, None) or '' for name in ('context', 'problem', 'reason'))
    said = [found.group().rstrip(' ,;:(') for text in texts if (found := _QUOTES_NOTHING.match(text))]
    if 'flow mapping' in (getattr(error, 'context', None) or ''):  # field: data[1] within braces
        said.append('a text that holds brackets, braces or commas has to stand in quotes there')
    return where + ', '.join(filter(None, said))
