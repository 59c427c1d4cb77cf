# SPDX-License-Identifier: Apache-2.0
"""
Extend Sphinx for this repository: source pages, offline equations and diagrams, references in docstrings.

Nothing in a page comes from the network. KaTeX translates equations to MathML, and Mermaid draws diagrams as SVG, both
during the build.
"""

from __future__ import annotations

import html
import json
import re
import shutil
from functools import cache
from importlib.resources import as_file, files
from pathlib import Path
from typing import Any

import mermaidx
import quickjs
from docutils import nodes
from pygments import highlight
from pygments.formatters import HtmlFormatter
from pygments.lexers import BashLexer, TextLexer, get_lexer_for_filename
from pygments.util import ClassNotFound
from sphinx.application import Sphinx

from studies.documents.site.api import defining, exports, packages
from studies.documents.site.gallery import REPORTS
from studies.documents.site.links import SCHEME, definition_lines, equation_numbers, with_equation_references
from studies.tools.provenance import ROOT

SOURCES = 'source'
"""Folder of the source pages in the site."""

MODEL = 'explanation/model.md'
"""Page of the numbered equations."""

FONT = 'STIXTwoMath-Regular.ttf'
"""Font of the equations, in the package ziamath."""

SOURCE_PAGE = """<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>{file}</title>
<link rel="stylesheet" href="{root}_static/pygments.css">
<link rel="stylesheet" href="{root}_static/styles/furo.css">
<link rel="stylesheet" href="{root}_static/site.css">
</head>
<body class="source">
<script>document.body.dataset.theme = localStorage.getItem("theme") || "auto";</script>
<p><a href="{root}index.html">Documentation</a></p>
<h1>{file}</h1>
{code}
</body>
</html>
"""

_FUNCTION = r'<mi>\w{2,}</mi><mo>\u2061</mo>'
_THIN_SPACE = '<mspace width="0.17em"></mspace>'

_used_sources: set[str] = set()


def setup(app: Sphinx) -> dict[str, bool]:
    """Connect the functions of this module."""
    app.add_html_math_renderer('mathml', inline_renderers=(_visit_math, None), block_renderers=(_visit_math, None))
    app.add_lexer('console', BashLexer)  # the blocks have no prompt, which Pygments requires of a console
    app.connect('builder-inited', _start)
    app.connect('doctree-read', _draw_diagrams)
    app.connect('doctree-resolved', _resolve_source_links)
    app.connect('autodoc-process-docstring', _refer_to_equations)
    app.connect('autodoc-process-signature', _name_aliases)
    app.connect('autodoc-skip-member', _skip_member)
    app.connect('missing-reference', _resolve_definition)
    app.connect('build-finished', _write_source_pages)
    return {'parallel_read_safe': False, 'parallel_write_safe': False}


def _start(app: Sphinx) -> None:
    """Forget an earlier build, and copy the font of the equations and the reports."""
    _used_sources.clear()
    static = Path(app.outdir, '_static')
    static.mkdir(parents=True, exist_ok=True)
    reports = Path(app.srcdir, '_extra', REPORTS)
    if reports.exists():
        shutil.copytree(reports, Path(app.outdir, REPORTS))
    with as_file(files('ziamath.fonts') / FONT) as font:
        shutil.copyfile(font, static / FONT)


# Equations


@cache
def _katex() -> Any:
    """Return KaTeX as a function of LaTeX and of whether the equation is a block."""
    engine = quickjs.Context()
    engine.eval(files('sphinxcontrib').joinpath('katex.min.js').read_text(encoding='utf-8'))
    # QuickJS passes strings that JavaScript has concatenated only as JSON.
    return engine.eval(
        '(text, block) => JSON.stringify(katex.renderToString(text, '
        "{displayMode: block, output: 'mathml', throwOnError: true, strict: 'error'}))"
    )


def mathml(latex: str, *, block: bool = False) -> str:
    """Return an equation as MathML; raise an error if KaTeX does not understand the LaTeX."""
    text = json.loads(_katex()(latex, block))
    # Chromium sets the font's accents into the letters; a mark that is no accent keeps its distance.
    text = text.replace('accent="true"', 'accent="false"')
    # A thin space separates a function from a factor and from an argument without brackets, as in TeX.
    text = re.sub(rf'(</m(?:i|n|row)>)(?={_FUNCTION})', rf'\1{_THIN_SPACE}', text)
    return re.sub(rf'({_FUNCTION})(?!<mo [^>]*>\()', rf'\1{_THIN_SPACE}', text)


def _visit_math(translator: Any, node: nodes.Element) -> None:
    is_block = isinstance(node, nodes.math_block)
    text = mathml(node.astext(), block=is_block)
    translator.body.append(f'<div class="math">{text}</div>' if is_block else text)
    raise nodes.SkipNode


# Diagrams


def _draw_diagrams(app: Sphinx, doctree: nodes.document) -> None:
    """Replace each block of Mermaid by its picture."""
    for number, block in enumerate(list(doctree.findall(nodes.literal_block))):
        if block.get('language') == 'mermaid':
            picture = mermaidx.render(block.astext()).svg().replace('my-svg', f'diagram-{number}')
            block.replace_self(nodes.raw('', f'<div class="diagram">{picture}</div>', format='html'))


# Source pages


def _resolve_source_links(app: Sphinx, doctree: nodes.document, page: str) -> None:
    """Point the links with the scheme of source files at the source pages."""
    for link in doctree.findall(nodes.reference):
        scheme, _, target = link.get('refuri', '').partition(':')
        if scheme == SCHEME:
            up = '../' * page.count('/')
            link['refuri'] = up + (target if target.startswith(f'{REPORTS}/') else _source_page(target))
            link['internal'] = True


def _source_page(target: str) -> str:
    """Return the address of a source page from the site's root; the build writes the page."""
    file, anchor, line = target.partition('#')
    _used_sources.add(file)
    return f'{SOURCES}/{file}.html{anchor}{line}'


def linkcode_resolve(domain: str, about: dict[str, str]) -> str | None:
    """Return the address of a documented object's source, from a page of the Python interface."""
    package, _, name = about['fullname'].partition('.')
    export = _exports(about['module']).get(package)
    if domain != 'py' or export is None:
        return None
    path = export.path
    line = definition_lines(path).get('.'.join(filter(None, (export.original, name))))
    target = f'{path.relative_to(ROOT)}' + (f'#line-{line}' if line else '')
    return f'../{_source_page(target)}'


@cache
def _exports(package: str) -> dict[str, Any]:
    return {export.name: defining(export) for export in exports(package)}


def _write_source_pages(app: Sphinx, error: Exception | None) -> None:
    """Write a page for each linked file of the repository, without the navigation, which would take a minute."""
    for file in sorted(_used_sources):
        path = Path(app.outdir, SOURCES, f'{file}.html')
        path.parent.mkdir(parents=True, exist_ok=True)
        root = '../' * (file.count('/') + 1)
        path.write_text(SOURCE_PAGE.format(file=html.escape(file), root=root, code=_coloured(file)), encoding='utf-8')


def _coloured(file: str) -> str:
    """Return the text of a file as HTML with numbered lines."""
    text = (ROOT / file).read_text(encoding='utf-8')
    try:
        lexer = get_lexer_for_filename(file, stripnl=False)
    except ClassNotFound:
        lexer = TextLexer(stripnl=False)
    return highlight(text, lexer, HtmlFormatter(lineanchors='line', linenos='inline', anchorlinenos=True))


# Docstrings


def _refer_to_equations(app: Sphinx, what: str, name: str, value: object, options: object, lines: list[str]) -> None:
    """Link the equations that a docstring names to the page of the model."""
    numbers = _equations_on(Path(app.srcdir, MODEL))
    lines[:] = with_equation_references('\n'.join(lines), numbers).split('\n')


@cache
def _equations_on(page: Path) -> list[int]:
    return equation_numbers(page.read_text(encoding='utf-8'))


def _name_aliases(
    app: Sphinx, what: str, name: str, value: object, options: object, signature: str | None, returned: str | None
) -> tuple[str | None, str | None]:
    """Return a signature with the names of aliases; autodoc does not resolve an alias within another type."""
    alias = re.compile(r"TypeAliasForwardRef\('[\w.]*?(\w+)'\)")
    signature, returned = (None if text is None else alias.sub(r'\1', text) for text in (signature, returned))
    return signature, returned


def _skip_member(app: Sphinx, what: str, name: str, value: object, skip: bool, options: object) -> bool | None:
    """Leave out the fields of named tuples that have no description."""
    return True if str(getattr(value, '__doc__', '')).startswith('Alias for field number') else None


@cache
def _definitions() -> dict[str, str]:
    """Return the full name under which the site describes each definition of the library."""
    found: dict[str, str] = {}
    for package in packages():
        for name, origin in _exports(package).items():
            found.setdefault(f'{origin.module}.{origin.original}', f'{package}.{name}')
    return found


def _resolve_definition(app: Sphinx, env: Any, node: nodes.Element, text: nodes.Element) -> nodes.Node | None:
    """
    Resolve a type in a signature by the module that defines the type.

    A type of another project, or a type that no package exports, is plain text: the site must not need the network, so
    that no inventory of another project is present.
    """
    if node.get('refdomain') != 'py' or node.get('reftype') != 'class':
        return None
    name = _definitions().get(node['reftarget'])
    if name is None:
        return text
    link = env.get_domain('py').resolve_xref(env, node['refdoc'], app.builder, 'obj', name, node, text)
    return link or text
