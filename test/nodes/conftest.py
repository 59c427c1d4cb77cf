# SPDX-License-Identifier: Apache-2.0
"""The graph that a test file's tests share."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from graph import Graph


@pytest.fixture(scope='module')
def graph() -> Iterator[Graph]:
    graph = Graph()
    yield graph
    graph.close()
