"""The search for effects keeps to the number of threads that it is allowed."""

from __future__ import annotations

import os

import pytest

from cfd_pneumatic.identification.threads import LIMIT, threads


@pytest.mark.parametrize(('limit', 'count'), [('1', 1), ('3', 3), ('4,2', 4)])
def test_as_many_as_the_environment_allows(monkeypatch, limit, count):
    monkeypatch.setenv(LIMIT, limit)
    assert threads() == count


@pytest.mark.parametrize('limit', ['', '0', '-1', 'many', None])
def test_as_many_as_there_are_cores_where_it_says_nothing(monkeypatch, limit):
    monkeypatch.delenv(LIMIT, raising=False)
    if limit is not None:
        monkeypatch.setenv(LIMIT, limit)
    assert threads() == os.cpu_count()
