# SPDX-License-Identifier: Apache-2.0
"""Read facts about the package from setup.py, without running it."""

from __future__ import annotations

import ast
from importlib import import_module
from typing import Any

from studies.tools.provenance import ROOT


def setup_arguments() -> dict[str, Any]:
    """Return the literal arguments of the call of `setup` in setup.py."""
    tree = ast.parse((ROOT / 'setup.py').read_text(encoding='utf-8'))
    call = next(node for node in ast.walk(tree) if isinstance(node, ast.Call) and ast.unparse(node.func) == 'setup')
    arguments = {}
    for keyword in call.keywords:
        try:
            arguments[str(keyword.arg)] = ast.literal_eval(keyword.value)
        except ValueError:
            continue
    return arguments


def programs() -> dict[str, str]:
    """Return the module of each program, by the program's name."""
    lines = setup_arguments()['entry_points']['console_scripts']
    start = import_module('cfd_pneumatic.runtime.start')
    return {name: getattr(start, name).args[0] for name, _, _ in (line.partition(' = ') for line in lines)}
