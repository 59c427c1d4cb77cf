# SPDX-License-Identifier: Apache-2.0
"""docs/reference/interface.md says what the running nodes say of themselves."""

from __future__ import annotations

import pytest

pytest.importorskip('pyarrow', reason='Dask is not to be had here, and the columns of its table stand in the document')

from cfd_pneumatic.convention import TOPICS, meaning
from cfd_pneumatic.model.effects import EFFECTS
from cfd_pneumatic.runtime.start import HELP
from studies.documents.help_pages import pages
from studies.documents.interface import DOCUMENT, document
from studies.documents.package_facts import programs


@pytest.fixture(scope='module')
def told():
    return document()


def test_the_interface_document_is_up_to_date(told):
    """`make interface-document` makes it."""
    assert DOCUMENT.read_text(encoding='utf-8').splitlines() == told.splitlines()


def test_the_pages_of_help_are_up_to_date():
    assert {path.stem: path.read_text(encoding='utf-8').split() for path in HELP.glob('*.txt')} == {
        name: page.split() for name, page in pages().items()
    }


def test_it_names_every_program_topic_and_effect(told):
    for name in (*programs(), *TOPICS, *EFFECTS):
        assert f'`{name}`' in told


def test_both_cylinders_topics_mean_the_same():
    assert meaning('cylinder_a/pressure') == meaning('cylinder_b/pressure')
    assert meaning('predicted/cylinder_b/pressure') == f'predicted: {meaning("cylinder_b/pressure")}'


def test_a_topic_that_nobody_has_described_is_missed():
    with pytest.raises(KeyError, match='temperature'):
        meaning('cylinder_a/temperature')
