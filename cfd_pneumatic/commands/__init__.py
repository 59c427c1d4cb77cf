"""
The offline programs.

Their threads are their own: those of NumPy's library beside them would only compete for the same cores, which doubles
the time on a busy machine. The library asks the environment once, when NumPy is loaded.
"""

import os

os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')
