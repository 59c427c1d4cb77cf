# SPDX-License-Identifier: Apache-2.0
"""
Whether names, docstrings, comments, messages, templates and pages follow the style guide.

    python -m studies.tools.prose                         # library, studies and pages
    python -m studies.tools.prose cfd_pneumatic/device    # some files or folders
    python -m studies.tools.prose --count                 # how many findings each package has

A finding is a line: file, line, what is wrong, what to write instead. Without places, the program also checks the size
of all pages together, and prints the readability of each page. `prose_rules.py` has the terms and exemptions.
The exit code is 1 if there are findings.
"""

from __future__ import annotations

import argparse
import ast
import io
import re
import sys
import tokenize
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

from studies.tools.prose_pages import Block, length_faults, pages, prose_of, score, size_faults
from studies.tools.prose_rules import EXEMPTIONS, HEAD_EXEMPTIONS, LONGEST_SENTENCE, NAMES, PUBLIC_NAMES, RULES

ROOT = Path(__file__).parents[2]
PLACES = ('cfd_pneumatic', 'studies', 'launch')
LEFT_OUT = ('composed.py', 'prose_rules.py')
_RULES = [(re.compile(rule.pattern, re.IGNORECASE), rule.instead) for rule in RULES]
_EXEMPT, _EXEMPT_HEAD = (
    [re.compile(exemption.pattern, re.IGNORECASE) for exemption in exemptions]
    for exemptions in (EXEMPTIONS, HEAD_EXEMPTIONS)
)
_SENTENCE_END = re.compile(r'(?<=[.!?:;])\s+|\n\s*\n|\n\s*[-*|]|\n\s*-{3,}')
_QUOTED = re.compile(r'`[^`]*`|\{[^{}]*\}|<[^<>]*>')
_MESSAGE = re.compile(r'[A-Za-z]{2,}[ ,:;].*[A-Za-z]{2,} [A-Za-z]')
"""A string literal that is a text: a phrase of three or more."""


_CODE = re.compile(r'\s*(SELECT|from|import) ')
"""Begin of a string literal that is code."""


class Text(NamedTuple):
    """A text for people, and the line of its beginning."""

    line: int
    content: str


class Finding(NamedTuple):
    """What is wrong in a file."""

    path: Path
    line: int
    message: str

    def __str__(self) -> str:
        """Return the finding in a line."""
        return f'{self.path}:{self.line}: {self.message}'


def findings_in(path: Path) -> Iterator[Finding]:
    """Yield what is wrong in a file of Python, a template or a page in Markdown."""
    source = path.read_text(encoding='utf-8')
    if path.suffix == '.md':
        yield from _findings_in_page(path, _prose(path))
        return
    if path.suffix == '.py':
        tree = ast.parse(source)
        texts = [*_docstrings_and_messages(tree), *_comments(source)]
        for line, name in _bound_names(tree):
            if name in NAMES and (path.name, name) not in PUBLIC_NAMES:
                yield Finding(path, line, f'name `{name}`: name the thing')
    else:
        texts = [Text(number, _plain(line)) for number, line in enumerate(source.splitlines(), 1)]
    for text in texts:
        for line, message in _faults(text):
            yield Finding(path, line, message)


def _prose(path: Path) -> list[Block]:
    """Return the texts of a page that the check covers."""
    return prose_of(_name(path), path.read_text(encoding='utf-8'))


def _name(path: Path) -> str:
    """Return the path of a page from the root of the repository."""
    return str(path.resolve().relative_to(ROOT)) if path.resolve().is_relative_to(ROOT) else path.name


def _findings_in_page(path: Path, texts: Sequence[Block]) -> Iterator[Finding]:
    for block in texts:
        exempt = _EXEMPT_HEAD if block.kind in {'heading', 'cell'} else []
        for line, message in _faults(Text(block.line, _blanked(block.content, exempt))):
            yield Finding(path, line, message)
    for line, message in length_faults(texts):
        yield Finding(path, line, message)


def findings_in_pages(root: Path) -> Iterator[Finding]:
    """Yield what is wrong with the size of a repository's pages together."""
    for message in size_faults((str(path.relative_to(root)), _prose(path)) for path in pages(root)):
        yield Finding(root / 'README.md', 1, message)


def readability(root: Path) -> Iterator[str]:
    """Yield a line for each page of a repository: words, mean length of a sentence, Flesch reading ease."""
    yield '  size  sentence  reading ease (100: very easy, 30: very difficult)'
    for path in pages(root):
        found = score(_prose(path))
        yield f'{found.size:6}  {found.sentence:8.1f}  {found.ease:4.0f}  {path.relative_to(root)}'


def _faults(text: Text) -> Iterator[tuple[int, str]]:
    content = _blanked(text.content, [_QUOTED, *_EXEMPT])
    for pattern, instead in _RULES:
        for found in pattern.finditer(content):
            line = text.line + content.count('\n', 0, found.start())
            yield line, f'"{found[0]}": write {instead}'
    prose = re.sub(r'(?m)^ {4,}python -m .*$', '', content)  # commands in a docstring
    for sentence in _SENTENCE_END.split(prose):
        length = len(re.findall(r"[A-Za-z][\w'-]*", sentence))
        if length > LONGEST_SENTENCE:
            yield (
                text.line,
                f'a sentence of {length}, at most {LONGEST_SENTENCE}: {" ".join(sentence.split())[:40]} ...',
            )


def _blanked(content: str, patterns: Sequence[re.Pattern[str]]) -> str:
    """Return a text with blanks in place of what the patterns match."""
    for pattern in patterns:
        content = pattern.sub(lambda found: ' ' * len(found[0]), content)
    return content


def _docstrings_and_messages(tree: ast.Module) -> Iterator[Text]:
    """Yield every string of a module that is a text, the parts of an f-string together."""
    parts = {id(value) for node in ast.walk(tree) if isinstance(node, ast.JoinedStr) for value in node.values}
    for node in ast.walk(tree):
        if isinstance(node, ast.JoinedStr):
            content = ''.join(
                part.value if isinstance(part, ast.Constant) and isinstance(part.value, str) else '{}'
                for part in node.values
            )
        elif isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in parts:
            content = node.value
        else:
            continue
        if _MESSAGE.search(content) and not _CODE.match(content):
            yield Text(node.lineno, content)


def _comments(source: str) -> Iterator[Text]:
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type == tokenize.COMMENT and not re.match(r'#\s*(noqa|type:|SPDX|!)', token.string):
            yield Text(token.start[0], token.string.lstrip('# '))


def _bound_names(tree: ast.Module) -> Iterator[tuple[int, str]]:
    for node in ast.walk(tree):
        if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            yield node.lineno, node.id
        elif isinstance(node, ast.arg):
            yield node.lineno, node.arg
        elif isinstance(node, (ast.FunctionDef, ast.ClassDef)):
            yield node.lineno, node.name


def _plain(line: str) -> str:
    """Return a line of a template without its tags and expressions."""
    return re.sub(r'\{[{%#].*?[}%#]\}|<[^>]*>', ' ', line)


def _files(places: Sequence[Path]) -> Iterator[Path]:
    for place in places:
        found = (
            [place]
            if place.is_file()
            else sorted(path for suffix in ('py', 'jinja', 'md') for path in place.rglob(f'*.{suffix}'))
        )
        yield from (path for path in found if path.name not in LEFT_OUT and '__pycache__' not in path.parts)


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the findings and the readability of the pages; return 1 if there are findings."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        'places', nargs='*', type=Path, help='files, folders; by default the library, the studies and the pages'
    )
    parser.add_argument('--count', action='store_true', help='print the number of findings in each folder')
    options = parser.parse_args(arguments)
    places = options.places or [*(ROOT / place for place in PLACES), *pages(ROOT)]
    found = [finding for path in _files(places) for finding in findings_in(path)]
    if not options.places:
        found += findings_in_pages(ROOT)
    if options.count:
        counts = Counter(str(finding.path.parent.relative_to(ROOT)) for finding in found)
        for folder, count in counts.most_common():
            print(f'{count:6} {folder}')
    else:
        print(*found, sep='\n')
        if not options.places:
            print(*readability(ROOT), sep='\n')
    print(f'{len(found)} findings', file=sys.stderr)
    return int(bool(found))


if __name__ == '__main__':
    sys.exit(main())
