# SPDX-License-Identifier: Apache-2.0
"""What `import cfd_pneumatic as cfd` adds to the exports of other packages; see docs/tutorials/python.md."""

from cfd_pneumatic.api.result import Result, identify
