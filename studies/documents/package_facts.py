# SPDX-License-Identifier: Apache-2.0
"""What setup.py says of the package; it is read and not run."""

from __future__ import annotations

import ast
from importlib import import_module
from typing import Any

from studies.tools.provenance import ROOT


def setup_arguments() -> dict[str, Any]:
    """Return those arguments of setup.py's `setup` that are literals."""
    tree = ast.parse((ROOT / 'setup.py').read_text(encoding='utf-8'))
    call = next(node for node in ast.walk(tree) if isinstance(node, ast.Call) and ast.unparse(node.func) == 'setup')
    found = {}
    for keyword in call.keywords:
        try:
            found[str(keyword.arg)] = ast.literal_eval(keyword.value)
        except ValueError:
            continue
    return found


def programs() -> dict[str, str]:
    """Return the module of each program, by the program's name."""
    lines = setup_arguments()['entry_points']['console_scripts']
    start = import_module('cfd_pneumatic.runtime.start')
    return {name: getattr(start, name).args[0] for name, _, _ in (line.partition(' = ') for line in lines)}
