# SPDX-License-Identifier: Apache-2.0
"""Read the files that users name; write results completely or not at all."""

from __future__ import annotations

from typing import TYPE_CHECKING

from cfd_pneumatic.lazy import loader_of

if TYPE_CHECKING:
    from cfd_pneumatic.files.inputs import check_input, open_input, read_input
    from cfd_pneumatic.files.results import ADVICE, ResultFiles, check_replaceable, marked, never
    from cfd_pneumatic.files.staging import (
        StagedOutput,
        check_folder,
        checksum,
        disk_errors_reported,
        exclusive_access,
        folder_entries,
        make_folder,
        remove_abandoned,
        staged_output,
        write_bytes,
        write_text,
    )
    from cfd_pneumatic.files.yaml_files import YamlMapping, read_yaml
else:
    __getattr__ = loader_of(__name__)
