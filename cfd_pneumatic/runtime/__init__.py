# SPDX-License-Identifier: Apache-2.0
"""Start programs and child processes, compile kernels and keep their machine code, and share work among threads."""

from __future__ import annotations

from typing import TYPE_CHECKING

from cfd_pneumatic.lazy import loader_of

if TYPE_CHECKING:
    from cfd_pneumatic.runtime.children import guard_multiprocessing, start_python
    from cfd_pneumatic.runtime.code_files import WARNED_FOLDER, is_trusted
    from cfd_pneumatic.runtime.code_files import read as read_code
    from cfd_pneumatic.runtime.code_files import write as write_code
    from cfd_pneumatic.runtime.compiling import LOCK_FILE, announced, compiler, folder_lock
    from cfd_pneumatic.runtime.parallel import LIMIT, map_in_threads, threads
    from cfd_pneumatic.runtime.start import BAD_INPUT, HELP, INTERRUPTED, print_help_or_version
else:
    __getattr__ = loader_of(__name__)
