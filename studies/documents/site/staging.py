# SPDX-License-Identifier: Apache-2.0
"""Copy the pages of the repository into the folder that Sphinx reads, and add the generated pages."""

from __future__ import annotations

import re
import shutil
from collections.abc import Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import NamedTuple

from studies.documents.site import api, gallery
from studies.documents.site.links import with_equation_targets, with_site_links
from studies.documents.site.notebook_page import notebook_page
from studies.tools.provenance import ROOT

DOCS = ROOT / 'docs'
NOTEBOOK = DOCS / 'tutorials' / 'python.ipynb'
NOTEBOOK_PAGE = 'tutorials/python_notebook.md'
"""Place of the notebook's page in the site: `tutorials/python` is the page with the same text."""

FRONT = {
    ROOT / 'README.md': 'readme.md',
    ROOT / 'CONTRIBUTING.md': 'contributing.md',
    ROOT / 'CHANGELOG.rst': 'changelog.rst',
}
"""Pages outside of docs, with their places in the site."""

SETTINGS = 'conf.py', '_static', '_templates'
"""Files of docs that are no content."""


class Group(NamedTuple):
    """A part of the navigation: its caption, and the folders and pages of docs that the part contains."""

    caption: str
    places: tuple[str, ...]


GROUPS = (
    Group('Tutorials', ('tutorials',)),
    Group('How-to guides', ('how_to',)),
    Group('Reference', ('reference',)),
    Group('Python interface', (api.FOLDER,)),
    Group('Explanation', ('explanation',)),
    Group('Gallery', ('gallery',)),
    Group('Measurements', ('measurements', 'figures')),
    Group('Development', ('contributing', 'development', 'design', 'changelog')),
)
"""The navigation in order. The last group also contains the pages of docs that no group names."""

TITLES = {FRONT[ROOT / 'README.md']: 'Overview', NOTEBOOK_PAGE: 'Python, as an executed notebook'}
"""Titles in the navigation of pages that have the title of another page."""


def stage(folder: Path, examples: Iterable[gallery.Example] = gallery.EXAMPLES) -> None:
    """
    Write the source of the site.

    Parameters
    ----------
    folder
        Folder to write; the folder must not exist.
    examples
        Recordings of the gallery of reports; none for a site without this gallery.

    """
    with ThreadPoolExecutor(1) as executor:
        # The programs record and identify while this process imports the library.
        extra = folder / '_extra' / gallery.REPORTS
        examples = tuple(examples)
        reports = executor.submit(gallery.write_reports, extra, examples) if examples else None
        order = [*_write_content(folder), *_write_interface(folder)]
        galleries = {'effects': gallery.effects_page()} | ({'reports': reports.result()} if reports else {})
    (folder / 'gallery').mkdir()
    for name, text in galleries.items():
        order.append(f'gallery/{name}.md')
        (folder / order[-1]).write_text(text, encoding='utf-8')
    index = folder / 'index.md'
    text = index.read_text(encoding='utf-8')
    index.write_text(text + navigation(text, [place for place in order if place != 'index.md']), encoding='utf-8')


def _write_content(folder: Path) -> list[str]:
    """Write the pages and pictures of the repository; return their places."""
    places = {path: str(path.relative_to(DOCS)) for path in content()} | FRONT | {NOTEBOOK: NOTEBOOK_PAGE}
    for path, place in places.items():
        target = folder / place
        target.parent.mkdir(parents=True, exist_ok=True)
        if path == NOTEBOOK:
            text = notebook_page(path, target, lambda text: with_site_links(text, NOTEBOOK, places))
            target.write_text(text, encoding='utf-8')
        elif path.suffix == '.md':
            text = with_site_links(path.read_text(encoding='utf-8'), path, places)
            target.write_text(with_equation_targets(text), encoding='utf-8')
        else:
            shutil.copyfile(path, target)
    return list(places.values())


def _write_interface(folder: Path) -> list[str]:
    """Write the pages of the Python interface; return their places."""
    return [f'{api.FOLDER}/{name}.rst' for name in api.write_pages(folder / api.FOLDER)]


def content() -> Iterator[Path]:
    """Yield the files of docs that are content."""
    for path in sorted(DOCS.rglob('*')):
        first = path.relative_to(DOCS).parts[0]
        if path.is_file() and first not in SETTINGS and path != NOTEBOOK:
            yield path


def navigation(index: str, places: Iterable[str]) -> str:
    """
    Return the hidden tables of contents of all pages.

    Parameters
    ----------
    index
        Text of the root page. Pages have the order in which this text links them; other pages follow.
    places
        Paths of the pages from the site's root.

    """
    linked = re.findall(r'\]\(([^)#\s]+)', index)
    pages = [place for place in places if place.endswith(('.md', '.rst')) and place != FRONT[ROOT / 'README.md']]
    pages.sort(key=lambda place: linked.index(place) if place in linked else len(linked))
    trees = [_tree('', [FRONT[ROOT / 'README.md']])]
    for group in GROUPS:
        trees.append(_tree(group.caption, [place for place in pages if _group_of(place) is group]))
    return '\n'.join(filter(None, trees))


def _group_of(place: str) -> Group:
    names = place.split('/')[0], place.rsplit('.', 1)[0]
    return next((group for group in GROUPS if set(names) & set(group.places)), GROUPS[-1])


def _tree(caption: str, pages: Iterable[str]) -> str:
    names = {page: page.rsplit('.', 1)[0] for page in pages}
    lines = [f'{_title(page)} <{name}>' if _title(page) else name for page, name in names.items()]
    if not lines:
        return ''
    options = [':hidden:', *([f':caption: {caption}'] if caption else [])]
    return '\n'.join(['', '```{toctree}', *options, '', *lines, '```', ''])


def _title(page: str) -> str:
    """Return the title of a page in the navigation, if the title differs from the heading of the page."""
    package = Path(page).stem.removeprefix(f'{api.PACKAGE}.')
    return package if page.startswith(f'{api.FOLDER}/') else TITLES.get(page, '')
