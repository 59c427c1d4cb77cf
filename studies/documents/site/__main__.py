# SPDX-License-Identifier: Apache-2.0
"""
Build the documentation site: make site.

    python -m studies.documents.site                # build/site
    python -m studies.documents.site --no-reports   # without the gallery of reports, for a look at the pages

All pages work offline: open build/site/index.html. A warning of Sphinx is an error.
"""

from __future__ import annotations

import argparse
import shutil
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

from sphinx.cmd.build import main as build

from studies.documents.site.gallery import EXAMPLES
from studies.documents.site.staging import DOCS, stage
from studies.tools.provenance import ROOT

SITE = ROOT / 'build' / 'site'
STRICT = ('--fail-on-warning', '--keep-going', '--nitpicky', '--fresh-env', '--quiet')


def main(arguments: Sequence[str] | None = None) -> int:
    """Build the site; return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--no-reports', action='store_true', help='leave out the gallery of reports')
    options = parser.parse_args(arguments)
    with tempfile.TemporaryDirectory() as name:
        source = Path(name, 'source')
        stage(source, () if options.no_reports else EXAMPLES)
        shutil.rmtree(SITE, ignore_errors=True)
        code = build([*STRICT, '-c', str(DOCS), '-d', str(Path(name, 'doctrees')), str(source), str(SITE)])
    if code == 0:
        print(f'Open {SITE / "index.html"}')
    return code


if __name__ == '__main__':
    sys.exit(main())
