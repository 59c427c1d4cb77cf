"""Reading the YAML files that people write: mappings and parameter files."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import yaml

from cfd_pneumatic.errors import InputError


def read_yaml(path: Path) -> Any:
    """
    Return what a YAML file holds.

    Raises
    ------
    InputError
        If the file can't be read, is not YAML, or holds a key twice.

    """
    try:
        return yaml.load(path.read_text(encoding='utf-8'), _Loader)
    except OSError as error:
        raise InputError(f'cannot read {path}: {error.strerror}') from error
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise InputError(f'{path} is not YAML: {" ".join(str(error).split())}') from error
    except InputError as error:
        raise InputError(f'{path}: {error}') from error


class _Loader(yaml.SafeLoader):
    """Refuses a key that is there twice: PyYAML would take the last without a word."""

    def compose_mapping_node(self, anchor: Any) -> yaml.MappingNode:
        """Return the node of a mapping."""
        node = super().compose_mapping_node(anchor)
        lines: dict[tuple[str, str], int] = {}
        for key, _ in node.value:
            if isinstance(key, yaml.ScalarNode):
                name, line = (key.tag, key.value), key.start_mark.line + 1
                if name in lines:
                    raise InputError(
                        f'line {line}: the key {key.value!r} stands in line {lines[name]} already: leave one out'
                    )
                lines[name] = line
        return node
