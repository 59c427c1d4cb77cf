from __future__ import annotations

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / 'scripts'))

TABLE = []


@pytest.fixture(scope='session')
def table():
    """Return the lines that are shown at the end."""
    return TABLE


def pytest_terminal_summary(terminalreporter):
    for line in TABLE:
        terminalreporter.write_line(line)
