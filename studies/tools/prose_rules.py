# SPDX-License-Identifier: Apache-2.0
"""Words that `make prose` refuses, what to write instead, and the exemptions."""

from __future__ import annotations

from typing import NamedTuple


class Rule(NamedTuple):
    """
    A wording that a text must not have.

    Attributes
    ----------
    pattern
        Regular expression, matched without regard to case.
    instead
        What to write.

    """

    pattern: str
    instead: str


class Exemption(NamedTuple):
    """
    Texts in which a wording is right.

    Attributes
    ----------
    pattern
        Regular expression of the wording with its context.
    reason
        Why it is right there.

    """

    pattern: str
    reason: str


class PageExemption(NamedTuple):
    """
    Parts of pages that a command writes from texts of programs.

    Attributes
    ----------
    page
        Pattern of the page's path.
    kinds
        Kinds of texts: `paragraph`, `heading`, `bullet`, `cell`.
    reason
        Why the check of pages does not cover the texts.

    """

    page: str
    kinds: tuple[str, ...]
    reason: str


LONGEST_SENTENCE = 30
"""Words of a sentence."""

LONGEST_BULLET = 80
"""Words of an entry of a list."""

LONGEST_CELL = 25
"""Words of a cell of a table."""

MOST_WORDS_OF_README = 1200
"""Words of README.md."""

MOST_WORDS_BY_HAND = 20_000
"""Words of all pages that no command writes."""

MOST_WORDS_OF_NOTES = 5000
"""Words of all notes in pages that commands write."""

GENERATED = (
    'docs/measurements/*.md',
    'docs/reference/effects.md',
    'docs/reference/interface.md',
    'docs/reference/licences.md',
    'docs/reference/mapping.md',
)
"""Patterns of the pages that commands write."""

PAGE_EXEMPTIONS = (
    PageExemption('docs/reference/licences.md', ('cell',), 'names of licences and packages'),
    PageExemption('docs/measurements/mistakes.md', ('cell',), 'messages of programs, checked in the source'),
    PageExemption('docs/measurements/foreign.md', ('cell',), 'messages of programs, checked in the source'),
    PageExemption('docs/measurements/measured_runs.md', ('cell',), 'messages of programs, checked in the source'),
)

RULES = (
    Rule(r'\b(?:un)?told\b|\btells?\b|\btelling\b|\bforet(?:old|ell\w*)\b', 'estimated, determines, predicts'),
    Rule(r'\bwhat (?:is|was|are) left\b|\bleft of\b|\bis left\b|\bleaves of\b', 'residual, remaining error'),
    Rule(r'\bthe rest\b(?! of the piston)', 'residual, the others by name'),
    Rule(r'\bsaid\b|\bsays?\b|\bwords\b|\bwording\b|\bspoken\b', 'reported, states, message, text'),
    Rule(r'\blaws?\b|\bdrawn\b', 'characteristic, curve, estimated'),
    Rule(r'\blives?\b(?! on)|\bstands?\b|\bstood\b|\bgoes with\b|\bgo with\b', 'is, is documented in, depends on'),
    Rule(r'\bdoubt\w*\b|\bsuspect\b|\bmistakes?\b', 'data check, warning, likely input error'),
    Rule(r'\bafter over before\b', 'error ratio (after / before)'),
    Rule(r'\bbeside\b|\bbesides\b', 'in addition to, together with, next to'),
    Rule(r'\bheld against\b', 'compared with'),
    Rule(r'\basks? whether\b|\basked whether\b', 'tests whether'),
    Rule(r'\bcompany\b|\bstrangers?\b|\bkin\b|\bwitness\w*\b|\bneighbours?\b', 'other effects, outlier, adjacent'),
    Rule(r'\bwhose\b(?= \w+ \w+ (?:is|are)\b)|(?:(?<=\. )|^)(?:Where|Whose|Of which|Of these|Of that)\b', 'if, when'),
    Rule(r'\bnobody\b|\bsomebody\b|\bwhoever\b|\bwhatever\b', 'the user, unknown, any'),
    Rule(r'\bfelt\b|\bsoftened\b', 'effective, compliance factor'),
    Rule(r"\bcan't\b|\bdon't\b|\bdoesn't\b|\bisn't\b|\bwon't\b|\baren't\b|\bwasn't\b", 'the long form'),
)

EXEMPTIONS = (
    Exemption(r'gas laws?', 'the physical law'),
    Exemption(r'standing wave', 'the physical term'),
    Exemption(r'(?:number|total) of words|\[words\]|words, (?:at most|mean length)', 'a size of a text'),
)

HEAD_EXEMPTIONS = (Exemption(r'^Where\b', 'a heading, or the head of a column, is no sentence'),)
"""Exemptions of headings and cells of pages."""

NAMES = ('one', 'own', 'other', 'others', 'told', 'untold', 'left')
"""Names that say nothing of what they hold."""

PUBLIC_NAMES = (('recording.py', 'others'),)
"""Files and names that stay, because users know them: `Recording.others`."""
