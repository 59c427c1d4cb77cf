# SPDX-License-Identifier: Apache-2.0
"""The Python interface that `import cfd_pneumatic as cfd` adds to the exports of other packages; see docs/python.md."""

from cfd_pneumatic.api.result import Result, identify
