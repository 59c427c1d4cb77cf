# SPDX-License-Identifier: Apache-2.0
"""
Reading YAML files: mappings, parameter files, and the metadata of bags.

The program reads all YAML here. The result has plain values only, and their number is limited even if aliases unfold.
Messages give line numbers and quote nothing: the file may be secret.
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
"""Size of a file that a user writes [bytes]; most have a hundredth of that."""

MOST_NODES = 50_000
"""Number of keys, values and lists of a file, with all aliases unfolded."""

_QUOTES_NOTHING = re.compile(r"""(?:[^'"]|'(?:\\?.|<[a-z ]+>)')*""")
"""The part of a PyYAML message before a quotation of several characters; `<block end>` is a kind of token."""


class YamlMapping(dict[Any, Any]):
    """
    Keys and values, with their line numbers.

    Attributes
    ----------
    line : int
        First line of the mapping in the file, counted from 1.
    lines : dict
        Line of each key.

    """

    line: int
    lines: dict[Any, int]


def read_yaml(path: Path, most: int = LARGEST, *, texts: bool = False) -> Any:
    """
    Return the content of a YAML file, with `YamlMapping` for mappings.

    Parameters
    ----------
    path : Path
        The file.
    most : int
        Largest accepted size [bytes].
    texts : bool
        Whether to return numbers, dates and booleans as texts.

    Raises
    ------
    InputError
        If the file cannot be read, is not YAML, is too large, unfolds to too many values, or repeats a key.

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
    """Loader of plain values with 64-bit numbers; an anchor may be repeated, as in YAML 1.2."""

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
            raise InputError(f'has more than {MOST_NODES:,} values: check that it is a settings file')
        if not self.check_event(yaml.AliasEvent):
            self.anchors.pop(self.peek_event().anchor, None)  # type: ignore[no-untyped-call]
        return super().compose_node(parent, index)

    def construct_object(self, node: yaml.Node, deep: bool = False) -> Any:
        try:
            return super().construct_object(node, deep)
        except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as error:
            # an impossible date, a number of thousands of digits, a tag that does not fit the value
            raise InputError(f'line {_line(node)}: holds a value that cannot be read') from error

    def construct_yaml_int(self, node: yaml.ScalarNode) -> int:
        value: int = super().construct_yaml_int(node)
        if not -(2**63) <= value < 2**63:
            raise InputError(f'line {_line(node)}: a number is too large')
        return value

    def construct_yaml_map(self, node: yaml.MappingNode) -> Generator[dict[Any, Any], None, None]:
        mapping = YamlMapping()
        yield mapping
        mapping.update(self.construct_mapping(node))
        mapping.line = _line(node)
        mapping.lines = {self.construct_object(key, deep=True): _line(key) for key, _ in node.value}


_Loader.add_constructor('tag:yaml.org,2002:int', _Loader.construct_yaml_int)
_Loader.add_constructor('tag:yaml.org,2002:map', _Loader.construct_yaml_map)


def _loaded(text: str, texts: bool) -> Any:
    """Return the content of a YAML text of limited size."""
    loader = _Loader(text, texts)
    try:
        node = loader.get_single_node()
        if node is not None and _count_values(node, {}) > MOST_NODES:
            raise InputError(f'unfolds to more than {MOST_NODES:,} values: write the values without aliases')
        return None if node is None else loader.construct_document(node)
    finally:
        loader.dispose()


def _count_values(node: yaml.Node, sizes: dict[int, int]) -> int:
    """Return the number of values that a node unfolds to; refuse repeated keys, of which PyYAML keeps the last."""
    if id(node) not in sizes:
        sizes[id(node)] = MOST_NODES + 1  # during the count: an alias that contains itself has no end
        children = list(node.value) if isinstance(node, yaml.SequenceNode) else []
        if isinstance(node, yaml.MappingNode):
            _refuse_repeated_keys(node)
            children = [child for pair in node.value for child in pair]
        sizes[id(node)] = min(1 + sum(_count_values(child, sizes) for child in children), MOST_NODES + 1)
    return sizes[id(node)]


def _refuse_repeated_keys(node: yaml.MappingNode) -> None:
    lines: dict[tuple[str, str], int] = {}
    for key, _ in node.value:
        if isinstance(key, yaml.ScalarNode):
            name = key.tag, key.value
            if name in lines:
                raise InputError(f'line {_line(key)}: the key is already in line {lines[name]}: remove one of the two')
            lines[name] = _line(key)


def _line(node: yaml.Node) -> int:
    """Return the line in which a node begins, counted from 1."""
    return int(node.start_mark.line) + 1


def _problem(error: yaml.YAMLError) -> str:
    """Return a description of a syntax error and its position, without a quotation from the text."""
    mark = getattr(error, 'problem_mark', None)
    position = '' if mark is None else f'line {mark.line + 1}, column {mark.column + 1}: '
    texts = (getattr(error, name, None) or '' for name in ('context', 'problem', 'reason'))
    reasons = [match.group().rstrip(' ,;:(') for text in texts if (match := _QUOTES_NOTHING.match(text))]
    if 'flow mapping' in (getattr(error, 'context', None) or ''):  # field: data[1] within braces
        reasons.append('put a text with brackets, braces or commas in quotes there')
    return position + ', '.join(filter(None, reasons))
