# SPDX-License-Identifier: Apache-2.0
"""The check of names, texts and pages finds what the style guide refuses, and nothing in this repository."""

from __future__ import annotations

from pathlib import Path

import pytest

pytest.importorskip('markdown_it', reason='markdown-it-py, which reads the pages, is not installed')

from studies.tools.prose import PLACES, ROOT, findings_in, findings_in_pages, main, readability
from studies.tools.prose_pages import Block, blocks, is_generated, length_faults, pages, prose_of, score, size_faults
from studies.tools.prose_rules import GENERATED, PAGE_EXEMPTIONS

SOURCE = '''
def take(one, path):
    """Return what is left of it beside the core."""
    # the law that was drawn, as it was told
    raise ValueError(f"{path} can't be read, so that nothing is said")
'''


def test_library_and_studies_have_no_findings(capsys):
    assert main([str(ROOT / place) for place in PLACES]) == 0, capsys.readouterr().out


@pytest.mark.parametrize('page', pages(ROOT), ids=lambda page: f'{page.parent.name}/{page.stem}')
def test_a_page_has_no_findings(page):
    assert [str(finding) for finding in findings_in(page)] == []


def test_the_pages_together_are_not_too_long():
    assert [str(finding) for finding in findings_in_pages(ROOT)] == []


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


PAGE = """# A heading

A paragraph with `code that is told` and a [label](told.md), $told = 1$ and ![picture](told.png).

- first entry
  of two lines

  and a paragraph
- second

| name | text |
| --- | --- |
| 12.5 | a cell |

    told = 'indented code'

```sh
told 'fenced code'
```

## Notes

> A quotation.
"""


def test_a_page_is_read_as_its_texts_without_code_and_targets():
    assert [(block.line, block.kind, block.heading, block.content) for block in blocks(PAGE)] == [
        (1, 'heading', 'A heading', 'A heading'),
        (3, 'paragraph', 'A heading', 'A paragraph with `code that is told` and a label, `equation` and picture.'),
        (5, 'bullet', 'A heading', 'first entry\nof two lines\n\nand a paragraph'),
        (9, 'bullet', 'A heading', 'second'),
        (11, 'cell', 'A heading', 'name'),
        (11, 'cell', 'A heading', 'text'),
        (13, 'cell', 'A heading', '12.5'),
        (13, 'cell', 'A heading', 'a cell'),
        (21, 'heading', 'Notes', 'Notes'),
        (23, 'paragraph', 'Notes', 'A quotation.'),
    ]


def test_code_of_a_page_is_no_finding(tmp_path):
    path = tmp_path / 'page.md'
    path.write_text(PAGE)
    assert list(findings_in(path)) == []


def test_wordings_and_long_sentences_of_a_page_are_found_in_their_lines(tmp_path):
    path = tmp_path / 'page.md'
    path.write_text(f'# Title\n\nA first line\nand what is left.\n\n- {"a value and " * 16}an end.\n')
    found = {(finding.line, finding.message.split(':')[0]) for finding in findings_in(path)}
    assert (4, '"what is left"') in found
    assert (6, 'a sentence of 50, at most 30') in found


@pytest.mark.parametrize(
    ('text', 'is_found'),
    [('## Where a change goes', False), ('| where |\n| - |\n| 1 |', False), ('Where a valve opens, air flows.', True)],
)
def test_where_may_begin_a_heading_but_no_sentence(tmp_path, text, is_found):
    path = tmp_path / 'page.md'
    path.write_text(f'{text}\n')
    assert bool(list(findings_in(path))) is is_found


@pytest.mark.parametrize(
    ('text', 'kind'), [(f'- {"word. " * 81}', 'bullet'), (f'| a |\n| - |\n| {"word. " * 26} |', 'cell')]
)
def test_long_bullets_and_cells_are_found(text, kind):
    ((_, message),) = length_faults(blocks(text))
    assert message.startswith(f'a {kind} of ')


@pytest.mark.parametrize('text', [f'- {"word. " * 80}', f'| a |\n| - |\n| {"word. " * 25} {"1.5 " * 9}|'])
def test_bullets_and_cells_at_the_limit_are_no_findings(text):
    assert list(length_faults(blocks(text))) == []


def test_quoted_messages_in_tables_are_exempt_but_notes_are_not():
    text = '| a |\n| - |\n| said |\n\n## Notes\n\n| a |\n| - |\n| told |\n'
    contents = [block.content for block in prose_of('docs/measurements/mistakes.md', text)]
    assert 'said' not in contents
    assert 'told' in contents


def test_every_exemption_and_generated_page_exists():
    for pattern in (*GENERATED, *(exemption.page for exemption in PAGE_EXEMPTIONS)):
        assert list(ROOT.glob(pattern)), pattern


@pytest.mark.parametrize(
    ('path', 'heading', 'length', 'subject'),
    [
        ('README.md', '', 1201, 'README.md has 1201'),
        ('docs/index.md', '', 20_001, 'The pages by hand have 20001'),
        ('docs/measurements/speed.md', 'Notes', 5001, 'The notes in generated pages have 5001'),
    ],
)
def test_too_many_words_are_found(path, heading, length, subject):
    texts = [Block(1, 'paragraph', heading, 'word ' * (length - 1))]
    assert list(size_faults([(path, texts)])) == []
    texts.append(Block(1, 'paragraph', heading, 'word'))
    (message,) = size_faults([(path, texts)])
    assert message.startswith(subject)


def test_only_notes_of_a_generated_page_count():
    assert is_generated('docs/measurements/speed.md')
    assert (
        list(size_faults([('docs/measurements/speed.md', [Block(1, 'paragraph', 'Growth', 'word ' * 30_000)])])) == []
    )


def test_the_reading_ease_is_that_of_flesch():
    """Two sentences, nine words, twelve syllables: 206.835 - 1.015 * 4.5 - 84.6 * 12 / 9."""
    found = score(blocks('The cat sat on a table. It purred happily.\n'))
    assert (found.size, found.sentence) == (9, 4.5)
    assert found.ease == pytest.approx(206.835 - 1.015 * 4.5 - 84.6 * 12 / 9)


def test_a_page_of_long_words_is_more_difficult():
    easy = score(blocks('The valve lets air in.'))
    difficult = score(blocks('Identification necessitates parametrisation.'))
    assert easy.ease > difficult.ease


def test_readability_is_printed_for_each_page():
    lines = list(readability(ROOT))
    assert len(lines) == 1 + len(pages(ROOT))
    assert lines[1].endswith('README.md')
