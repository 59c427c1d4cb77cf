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


LONGEST_SENTENCE = 30
"""Words of a sentence."""

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

EXEMPTIONS = (Exemption(r'gas laws?', 'the physical law'), Exemption(r'standing wave', 'the physical term'))

NAMES = ('one', 'own', 'other', 'others', 'told', 'untold', 'left')
"""Names that say nothing of what they hold."""

PUBLIC_NAMES = (('recording.py', 'others'),)
"""Files and names that stay, because users know them: `Recording.others`."""
