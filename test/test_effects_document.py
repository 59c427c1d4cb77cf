# SPDX-License-Identifier: Apache-2.0
"""docs/reference/effects.md says what the effects' own files say, of each of them."""

from __future__ import annotations

from cfd_pneumatic.model.effects import EFFECTS
from studies.documents.effects import AXES, DOCUMENT, ON_RIG, PICTURES, document

TEXT = document()


def test_the_effects_document_is_up_to_date():
    """`make effects-document` makes it."""
    assert DOCUMENT.read_text(encoding='utf-8') == TEXT


def test_it_has_a_section_for_every_effect():
    headings = [line[3:] for line in TEXT.splitlines() if line.startswith('## ')]
    assert headings[:-1] == sorted(EFFECTS)


def test_every_effect_that_the_rig_has_is_drawn():
    drawn = {path.stem for path in PICTURES.glob('*.svg')}
    assert drawn == EFFECTS.keys() & ON_RIG.keys()
    assert [name for name in drawn if f'({PICTURES.name}/{name}.svg)' not in TEXT] == []


def test_every_effect_is_drawn_against_something_that_has_an_axis():
    assert {effect.seen_against for effect in EFFECTS.values()} <= AXES.keys()


def test_no_parameter_is_left_bare_in_an_equation():
    """In a formula `lag` would be l times a times g."""
    for effect in EFFECTS.values():
        for one in effect.parameters:
            assert r'\mathit{' + one.name.replace('_', r'\_') + '}' in TEXT
