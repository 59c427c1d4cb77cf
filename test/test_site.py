# SPDX-License-Identifier: Apache-2.0
"""The documentation site has every page, and its links, equations and pictures work without network."""

from __future__ import annotations

import base64
import json
import re
from pathlib import Path

import pytest

import cfd_pneumatic
from studies.documents.site import api, gallery, staging
from studies.documents.site.links import (
    definition_lines,
    equation_numbers,
    source_link,
    with_equation_references,
    with_equation_targets,
    with_site_links,
)
from studies.documents.site.notebook_page import notebook_page

ROOT = Path(__file__).parents[1]
MODEL = ROOT / 'docs' / 'explanation' / 'model.md'
PNG = b'\x89PNG of a test'


@pytest.fixture
def repository(tmp_path: Path) -> Path:
    """Return a repository with a page in docs, a README and a module."""
    (tmp_path / 'docs' / 'how_to').mkdir(parents=True)
    (tmp_path / 'docs' / 'how_to' / 'page.md').write_text('# Page\n')
    (tmp_path / 'README.md').write_text('# Read me\n')
    (tmp_path / 'module.py').write_text('import re\n\n\nclass Known:\n    field: int = 0\n')
    return tmp_path


@pytest.mark.parametrize(
    ('link', 'changed'),
    [
        ('[a](../../README.md#part)', '[a](../readme.md#part)'),
        ('![a](page.md)', '![a](page.md)'),
        ('[`module.py`: `Known.field`](../../module.py)', '[`module.py`: `Known.field`](source:module.py#line-5)'),
        ('[`module.py`](../../module.py)', '[`module.py`](source:module.py)'),
        ('[the pages](..)', 'the pages'),
        ('[a](https://example.org/a)', '[a](https://example.org/a)'),
        ('[a](#part)', '[a](#part)'),
        ('```sh\n[a](../../README.md)\n```', '```sh\n[a](../../README.md)\n```'),
    ],
)
def test_links_are_adapted_to_the_site(repository, link, changed):
    page = repository / 'docs' / 'how_to' / 'page.md'
    places = {page: 'how_to/page.md', repository / 'README.md': 'readme.md'}
    assert with_site_links(f'{link}\n', page, places, repository) == f'{changed}\n'


def test_a_link_to_no_file_is_an_error(repository):
    page = repository / 'docs' / 'how_to' / 'page.md'
    with pytest.raises(FileNotFoundError, match=r'gone\.md'):
        with_site_links('[a](gone.md)', page, {page: 'how_to/page.md'}, repository)


def test_source_links_lead_to_the_line_of_a_definition():
    path = ROOT / 'cfd_pneumatic' / 'errors.py'
    line = definition_lines(path)['InputError']
    assert path.read_text(encoding='utf-8').splitlines()[line - 1].startswith('class InputError')
    assert source_link(path, 'InputError') == f'source:cfd_pneumatic/errors.py#line-{line}'


EQUATIONS = """Text with (3).

```math
a = b \\quad (1) \\qquad c = d \\quad (2)
```

```math
a(2) = b \\quad (1)
```
"""


def test_each_equation_has_one_target():
    assert equation_numbers(EQUATIONS) == [1, 2]
    text = with_equation_targets(EQUATIONS)
    assert re.findall(r'^\(equation-\d\)=$', text, re.MULTILINE) == ['(equation-1)=', '(equation-2)=']
    assert '(equation-2)=\n```math\na = b' in text


def test_docstrings_refer_to_equations_that_are_on_the_page():
    text = with_equation_references('By equations (1), (3) and (2); (1) alone, equation (1).', [1, 2])
    first, second = (f':ref:`({number}) <equation-{number}>`' for number in (1, 2))
    assert text == f'By equations {first}, (3) and {second}; (1) alone, equation {first}.'


def test_the_page_of_the_model_has_every_equation_that_docstrings_name():
    named: set[str] = set()
    for path in (ROOT / 'cfd_pneumatic').rglob('*.py'):
        for phrase in re.findall(r'[Ee]quations? ((?:\(\d+\)(?:,| and| to)? ?)+)', path.read_text(encoding='utf-8')):
            named.update(re.findall(r'\d+', phrase))
    assert len(named) > 5
    assert {int(number) for number in named} <= set(equation_numbers(MODEL.read_text(encoding='utf-8')))


def test_a_notebook_is_shown_with_its_outputs(tmp_path):
    cells = [
        {'cell_type': 'markdown', 'source': ['# Title\n', '[a](b.md)']},
        {
            'cell_type': 'code',
            'source': ['!ls'],
            'outputs': [{'output_type': 'stream', 'text': ['\x1b[1mfile\x1b[0m\r\n']}],
        },
        {
            'cell_type': 'code',
            'source': ['plot()'],
            'outputs': [{'output_type': 'display_data', 'data': {'image/png': base64.b64encode(PNG).decode()}}],
        },
    ]
    notebook = tmp_path / 'notebook.ipynb'
    notebook.write_text(json.dumps({'cells': cells}))
    text = notebook_page(notebook, tmp_path / 'page.md', lambda text: text.replace('b.md', 'c.md'))
    assert text == (
        '# Title\n[a](c.md)\n\n```sh\nls\n```\n\n```{code-block} text\n:class: output\n\nfile\n```\n\n'
        '```python\nplot()\n```\n\n![Output of the cell above](page_1.png)\n'
    )
    assert (tmp_path / 'page_1.png').read_bytes() == PNG


def test_the_python_interface_has_every_public_name():
    text, described = api.page('cfd_pneumatic')
    assert set(described.values()) == {f'cfd_pneumatic.{name}' for name in cfd_pneumatic.__all__}
    for name in cfd_pneumatic.__all__:
        assert re.search(rf'^\.\. auto(class|function):: {name}$', text, re.MULTILINE), name


def test_every_layer_with_exports_has_a_page():
    assert {'cfd_pneumatic.model', 'cfd_pneumatic.recording', 'cfd_pneumatic.rig'} <= set(api.packages())


def test_a_name_is_described_on_one_page_and_linked_from_others():
    _, described = api.page('cfd_pneumatic')
    text, more = api.page('cfd_pneumatic.recording', described)
    assert ':py:obj:`Recording <cfd_pneumatic.Recording>`' in text
    assert '.. autoclass:: Recording\n' not in text
    assert not set(described) & set(more)


def test_a_constant_has_the_text_below_its_assignment():
    text, _ = api.page('cfd_pneumatic.recording')
    assert '.. py:data:: GAUGE\n\n   References of a pressure.\n' in text


def test_the_navigation_has_every_page_once_in_the_order_of_the_index():
    index = '[b](how_to/b.md) [a](how_to/a.md)\n'
    places = ['readme.md', 'how_to/a.md', 'how_to/b.md', 'how_to/c.md', 'other/d.md', 'how_to/picture.png', 'design.md']
    trees = re.findall(
        r'```\{toctree\}\n:hidden:\n(?::caption: ([^\n]*)\n)?\n(.*?)\n```', staging.navigation(index, places), re.S
    )
    assert trees == [
        ('', 'Overview <readme>'),
        ('How-to guides', 'how_to/b\nhow_to/a\nhow_to/c'),
        ('Development', 'other/d\ndesign'),
    ]


def test_the_gallery_has_every_plot_of_an_effect():
    text = gallery.effects_page()
    names = {path.stem for path in gallery.PICTURES.glob('*.svg')}
    assert names == set(re.findall(r'effects\.md#(\w+)\)', text))


def test_verdicts_name_the_effects():
    found = {
        'cylinder_a': {'verdict': 'effect_found', 'effects': ['valve_dead_band', 'leakage']},
        'cylinder_b': {'verdict': 'nothing_missing', 'effects': []},
    }
    text = gallery.verdicts(found)
    assert text.startswith('Cylinder A: ')
    assert 'valve dead band and leakage; Cylinder B: ' in text


@pytest.fixture(scope='module')
def extension():
    for module in ('sphinx', 'myst_parser', 'numpydoc', 'furo', 'mermaidx', 'quickjs', 'ziamath'):
        pytest.importorskip(module, reason='the extra docs is not installed')
    from studies.documents.site import extension

    return extension


PAGES = [ROOT / 'README.md', *sorted((ROOT / 'docs').rglob('*.md'))]


@pytest.mark.parametrize('page', PAGES, ids=lambda page: f'{page.parent.name}/{page.stem}')
def test_every_equation_becomes_mathml(extension, page):
    text = page.read_text(encoding='utf-8')
    for latex in re.findall(r'^```math\n(.*?)^```$', text, re.MULTILINE | re.DOTALL):
        assert '<math' in extension.mathml(latex, block=True)
    for latex in re.findall(r'(?<!\\)\$([^$\n`]+)\$', re.sub(r'```.*?```|`[^`\n]*`', '', text, flags=re.DOTALL)):
        assert '<math' in extension.mathml(latex)


def test_latex_that_katex_does_not_know_is_an_error(extension):
    with pytest.raises(Exception, match='Undefined control sequence'):
        extension.mathml(r'\unknown')


INDEX = """# Title

A number $x$, [the error](source:cfd_pneumatic/errors.py#line-1), [a report](source:reports/one.html).

```math
x = \\frac{1}{2}
```

```mermaid
flowchart LR
    first --> second
```
"""


@pytest.fixture(scope='module')
def site(extension, tmp_path_factory) -> Path:
    """Build a site of one page with the settings of docs/conf.py."""
    from sphinx.cmd.build import main

    folder = tmp_path_factory.mktemp('site')
    (folder / 'source' / '_extra' / 'reports').mkdir(parents=True)
    (folder / 'source' / '_extra' / 'reports' / 'one.html').write_text('A report.')
    (folder / 'source' / 'index.md').write_text(INDEX)
    arguments = ['--fail-on-warning', '--quiet', '-c', str(ROOT / 'docs'), str(folder / 'source'), str(folder / 'site')]
    assert main(arguments) == 0
    return folder / 'site'


def test_source_files_and_reports_are_pages_of_the_site(site):
    text = (site / 'index.html').read_text(encoding='utf-8')
    assert 'href="source/cfd_pneumatic/errors.py.html#line-1"' in text
    assert 'id="line-1"' in (site / 'source' / 'cfd_pneumatic' / 'errors.py.html').read_text(encoding='utf-8')
    assert 'href="reports/one.html"' in text
    assert (site / 'reports' / 'one.html').read_text() == 'A report.'


def test_equations_and_diagrams_need_no_script(site):
    text = (site / 'index.html').read_text(encoding='utf-8')
    assert text.count('<math') == 2
    assert re.search(r'<div class="diagram"><svg.*second.*</svg></div>', text, re.DOTALL)
    assert (site / '_static' / 'STIXTwoMath-Regular.ttf').stat().st_size > 100_000


def test_the_site_loads_nothing_from_the_network(site):
    for page in site.rglob('*.html'):
        text = page.read_text(encoding='utf-8')
        assert re.findall(r'<(?:script|link|img|iframe)[^>]*(?:src|href)="(?:https?:)?//', text) == []
    for style in site.rglob('*.css'):
        assert re.findall(r'(?:@import|url\()\s*["\']?(?:https?:)?//', style.read_text(encoding='utf-8')) == []
