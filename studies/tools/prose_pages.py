# SPDX-License-Identifier: Apache-2.0
"""
Check the prose of the pages in Markdown: wordings, lengths, readability.

Code blocks, link targets, equations and numbers are no prose. Inline code counts as one word of a page.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from fnmatch import fnmatch
from pathlib import Path
from typing import NamedTuple

from markdown_it import MarkdownIt
from markdown_it.token import Token

from studies.tools.prose_rules import (
    GENERATED,
    LONGEST_BULLET,
    LONGEST_CELL,
    MOST_WORDS_BY_HAND,
    MOST_WORDS_OF_NOTES,
    MOST_WORDS_OF_README,
    PAGE_EXEMPTIONS,
)

NOTES = 'Notes'
"""Heading of the handwritten part of a generated page."""

_PARSER = MarkdownIt('commonmark').enable('table')
_EQUATION = re.compile(r'\$[^$\n]+\$')
_CODE = re.compile(r'`[^`]*`')
_WORD = re.compile(r"[A-Za-zÀ-ÿ](?:[\w'’/.-]*\w)?")
_LETTERS = re.compile(r"[A-Za-zÀ-ÿ]+(?:['’-][A-Za-zÀ-ÿ]+)*")
_SENTENCE_END = re.compile(r'[.!?:;](?:\s|$)')
_VOWELS = re.compile(r'[aeiouy]+')


class Block(NamedTuple):
    """
    A text of a page.

    Attributes
    ----------
    line
        Line of the beginning.
    kind
        `paragraph`, `heading`, `bullet` or `cell`.
    heading
        Heading of the section.
    content
        Text; inline code is in backticks.

    """

    line: int
    kind: str
    heading: str
    content: str

    @property
    def words(self) -> int:
        """Number of words; inline code is one word, a number is none."""
        return len(_WORD.findall(_CODE.sub('code', self.content)))


class PageScore(NamedTuple):
    """
    Size and readability of a page.

    Attributes
    ----------
    size
        Number of words.
    sentence
        Mean length of a sentence [words].
    ease
        Flesch reading ease: 100 is very easy, 30 is very difficult.

    """

    size: int
    sentence: float
    ease: float


def blocks(text: str) -> list[Block]:
    """Return the texts of a page in Markdown in order."""
    found: list[Block] = []
    heading, kinds, line = '', ['paragraph'], 1
    for token in _PARSER.parse(text):
        kind = {'heading': 'heading', 'list_item': 'bullet', 'td': 'cell', 'th': 'cell'}.get(
            token.type.rpartition('_')[0]
        )
        line = token.map[0] + 1 if token.map else line
        if kind and token.nesting == 1:
            kinds.append(kind)
            if kind == 'bullet':
                found.append(Block(line, kind, heading, ''))
        elif kind and token.nesting == -1:
            kinds.pop()
        elif token.type == 'inline':
            content = _visible(token)
            if kinds[-1] == 'heading':
                heading = content
            _add(found, Block(line, kinds[-1], heading, content))
    return [block for block in found if block.content]


def _add(found: list[Block], block: Block) -> None:
    """Add a block; a paragraph of a bullet belongs to the bullet."""
    if block.kind == 'bullet':
        start = found.pop()
        block = start._replace(content='\n\n'.join(filter(None, (start.content, block.content))))
    found.append(block)


def _visible(token: Token) -> str:
    """Return the text that a reader sees, with inline code in backticks and without equations."""
    parts = []
    for child in token.children or ():
        if child.type == 'code_inline':
            parts.append(f'`{child.content}`')
        elif child.type in {'softbreak', 'hardbreak'}:
            parts.append('\n')
        elif child.type in {'text', 'image'}:
            parts.append(child.content)
        elif child.type == 'html_inline':
            parts.append(' ')
    return _EQUATION.sub('`equation`', ''.join(parts))


def prose_of(path: str, text: str) -> list[Block]:
    """Return the texts of a page that the check covers: without those that `PAGE_EXEMPTIONS` lists."""
    return [
        block
        for block in blocks(text)
        if not any(
            fnmatch(path, exemption.page) and block.kind in exemption.kinds and block.heading != NOTES
            for exemption in PAGE_EXEMPTIONS
        )
    ]


def length_faults(texts: Iterable[Block]) -> Iterator[tuple[int, str]]:
    """Yield the line and the description of each bullet and cell that is too long."""
    limits = {'bullet': LONGEST_BULLET, 'cell': LONGEST_CELL}
    for block in texts:
        limit = limits.get(block.kind)
        if limit is not None and block.words > limit:
            yield block.line, f'a {block.kind} of {block.words} words, at most {limit}: {block.content[:40]!r} ...'


def score(texts: Sequence[Block]) -> PageScore:
    """Return the size and the readability of texts."""
    sentences = [
        letters
        for block in texts
        if block.kind in {'paragraph', 'bullet'}
        for sentence in _SENTENCE_END.split(_CODE.sub(' ', block.content))
        if len(letters := _LETTERS.findall(sentence)) > 1
    ]
    words = [word for sentence in sentences for word in sentence]
    length = len(words) / max(len(sentences), 1)
    syllables = sum(map(_syllables, words)) / max(len(words), 1)
    return PageScore(sum(block.words for block in texts), length, 206.835 - 1.015 * length - 84.6 * syllables)


def _syllables(word: str) -> int:
    """Estimate the number of syllables of a word: its groups of vowels, without a silent e at the end."""
    groups = len(_VOWELS.findall(word.lower()))
    is_silent = bool(re.search(r'[^aeiouyl]e$|[^aeiouytd]ed$', word.lower()))
    return max(groups - is_silent, 1)


def is_generated(path: str) -> bool:
    """Return whether a command writes a page; only the notes of the page are by hand."""
    return any(fnmatch(path, pattern) for pattern in GENERATED)


def size_faults(pages: Iterable[tuple[str, Sequence[Block]]]) -> Iterator[str]:
    """Yield a description of each total of words that is too large, from all pages by path."""
    readme, by_hand, notes = 0, 0, 0
    for path, texts in pages:
        words = sum(block.words for block in texts)
        if is_generated(path):
            notes += sum(block.words for block in texts if block.heading == NOTES)
        else:
            by_hand += words
        readme += words if path == 'README.md' else 0
    for subject, words, limit in (
        ('README.md has', readme, MOST_WORDS_OF_README),
        ('The pages by hand have', by_hand, MOST_WORDS_BY_HAND),
        ('The notes in generated pages have', notes, MOST_WORDS_OF_NOTES),
    ):
        if words > limit:
            yield f'{subject} {words} words, at most {limit}'


def pages(root: Path) -> list[Path]:
    """Return the pages of a repository in Markdown."""
    return [root / 'README.md', root / 'CONTRIBUTING.md', *sorted((root / 'docs').rglob('*.md'))]
