# SPDX-License-Identifier: Apache-2.0
"""docs/reference/mapping.md says what the reader of mapping files takes."""

from __future__ import annotations

from cfd_pneumatic.recording.mapping import read_mapping
from studies.documents.mapping import BAG, DOCUMENT, EXAMPLE, document


def test_the_page_is_up_to_date():
    """`make interface-document` makes it."""
    assert DOCUMENT.read_text(encoding='utf-8') == document()


def test_the_examples_are_read(tmp_path):
    (tmp_path / 'bag.yaml').write_text(BAG)
    assert {one.name for one in read_mapping(tmp_path / 'bag.yaml').channels} == {
        *('displacement', 'force', 'tool_force'),
        *('cylinder_a pressure', 'cylinder_a setpoint', 'cylinder_b pressure'),
    }
    assert read_mapping(EXAMPLE).table is not None
