# SPDX-License-Identifier: Apache-2.0
"""Settings of Sphinx for the documentation site; `make site` builds the site."""

from __future__ import annotations

import sys
from pathlib import Path
from xml.etree import ElementTree

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from studies.documents.site.extension import linkcode_resolve  # noqa: E402, F401

project = 'cfd_pneumatic'
author = 'cfd_pneumatic maintainers'
copyright = author
version = release = str(ElementTree.parse(ROOT / 'package.xml').findtext('version'))
language = 'en'

extensions = [
    'myst_parser',
    'numpydoc',
    'sphinx.ext.autodoc',
    'sphinx.ext.linkcode',
    'studies.documents.site.extension',
]
root_doc = 'index'
exclude_patterns = ['_extra']

myst_enable_extensions = ['colon_fence', 'dollarmath']
myst_fence_as_directive = ['math']
myst_heading_anchors = 4
myst_url_schemes = ['http', 'https', 'mailto', 'source']

# Docstrings write code with single backticks.
default_role = 'code'
autodoc_member_order = 'bysource'
autodoc_class_signature = 'mixed'
autodoc_preserve_defaults = True
autodoc_type_aliases = {'Array': 'cfd_pneumatic.arrays.Array'}
numpydoc_show_class_members = False
numpydoc_xref_param_type = False
python_use_unqualified_type_names = True
python_maximum_signature_line_length = 140

html_theme = 'furo'
pygments_dark_style = 'github-dark'
html_title = f'{project} {release}'
html_static_path = ['_static']
html_css_files = ['site.css']
html_show_sourcelink = False
html_copy_source = False
html_show_search_summary = False  # a browser does not let the page of a file read other files
html_math_renderer = 'mathml'
