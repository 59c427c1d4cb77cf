# SPDX-License-Identifier: Apache-2.0
"""The check of names and texts finds what the style guide refuses, and nothing in the library."""

from __future__ import annotations

from pathlib import Path

import pytest

from studies.tools.prose import findings_in, main

SOURCE = '''
def take(one, path):
    """Return what is left of it beside the core."""
    # the law that was drawn, as it was told
    raise ValueError(f"{path} can't be read, so that nothing is said")
'''


def test_library_and_studies_have_no_findings(capsys):
    assert main([]) == 0, capsys.readouterr().out


@pytest.fixture
def messages(tmp_path: Path) -> str:
    path = tmp_path / 'module.py'
    path.write_text(SOURCE)
    return '\n'.join(map(str, findings_in(path)))


@pytest.mark.parametrize('wording', ['`one`', 'what is left', 'beside', 'law', 'drawn', 'told', "can't", 'said'])
def test_wordings_are_found(messages, wording):
    assert wording in messages


def test_long_sentences_are_found(tmp_path):
    path = tmp_path / 'module.py'
    path.write_text(f'"""Return {"a value and " * 16}an end."""\n')
    (finding,) = findings_in(path)
    assert 'a sentence of 51' in str(finding)


def test_templates_are_read_without_their_tags(tmp_path):
    path = tmp_path / 'page.html.jinja'
    path.write_text('<p class="told">{{ told }} The law</p>\n')
    (finding,) = findings_in(path)
    assert '"law"' in str(finding)


def test_physical_terms_are_no_findings(tmp_path):
    path = tmp_path / 'module.py'
    path.write_text('"""Return the pressure by the ideal gas law."""\n')
    assert list(findings_in(path)) == []
