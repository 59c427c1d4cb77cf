# SPDX-License-Identifier: Apache-2.0
"""Write the extended model's kernel from the effects: make kernel."""

import sys
from pathlib import Path
from types import ModuleType

MODEL = Path(__file__).parents[1] / 'model'

if __name__ == '__main__':
    # The model's face imports the kernel, which may not be there yet or be out of date.
    bare = ModuleType('cfd_pneumatic.model')
    bare.__path__ = [str(MODEL)]
    sys.modules['cfd_pneumatic.model'] = bare

    from cfd_pneumatic.files import write_text
    from cfd_pneumatic.generator.composition import composed

    write_text(MODEL / 'composed.py', composed())
