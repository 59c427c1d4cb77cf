# SPDX-License-Identifier: Apache-2.0
"""Each threshold has a unit and an origin, and a module uses it."""

from __future__ import annotations

import ast
import re
from itertools import zip_longest
from pathlib import Path

import pytest

import cfd_pneumatic.identification

PACKAGE = Path(cfd_pneumatic.identification.__file__).parent
FILES = sorted(PACKAGE.parent.rglob('thresholds.py'))


@pytest.mark.parametrize('path', FILES, ids=lambda path: path.parent.name)
def test_each_threshold_has_a_unit_and_an_origin(path):
    body = ast.parse(path.read_text(encoding='utf-8')).body
    assignments = {ast.unparse(one): after for one, after in zip_longest(body, body[1:]) if isinstance(one, ast.Assign)}
    assert assignments
    for assignment, after in assignments.items():
        text = ast.literal_eval(after.value) if isinstance(after, ast.Expr) else ''
        assert re.search(r'\[[^]]+\](.|\n)*\bOrigin: ', text), assignment


@pytest.mark.parametrize('path', FILES, ids=lambda path: path.parent.name)
def test_each_threshold_is_used_in_its_package(path):
    body = ast.parse(path.read_text(encoding='utf-8')).body
    names = [one.targets[0].id for one in body if isinstance(one, ast.Assign)]
    sources = [one.read_text(encoding='utf-8') for one in path.parent.glob('*.py') if one != path]
    unused = [name for name in names if sum(len(re.findall(rf'\b{name}\b', text)) for text in sources) < 2]
    assert unused == []
    assert len(set(names)) == len(names)
