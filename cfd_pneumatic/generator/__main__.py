# SPDX-License-Identifier: Apache-2.0
"""Write the extended model's kernel from the effects; called by `make kernel`."""

import sys
from pathlib import Path
from types import ModuleType

MODEL = Path(__file__).parents[1] / 'model'

if __name__ == '__main__':
    # The package's __init__.py imports the kernel, which may be missing or out of date.
    package = ModuleType('cfd_pneumatic.model')
    package.__path__ = [str(MODEL)]
    sys.modules['cfd_pneumatic.model'] = package

    from cfd_pneumatic.files import write_text
    from cfd_pneumatic.generator.composition import composed_source

    write_text(MODEL / 'composed.py', composed_source())
