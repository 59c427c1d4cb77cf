# SPDX-License-Identifier: Apache-2.0
"""What `import cfd_pneumatic as cfd` offers beyond the names of other packages, see docs/python.md."""

from cfd_pneumatic.api.result import Result, identify
