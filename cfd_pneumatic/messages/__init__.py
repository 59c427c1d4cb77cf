# SPDX-License-Identifier: Apache-2.0
"""
Serialised messages: their definitions, the places of numbers in them, and new messages with given numbers.

Bags and nodes share this package. It does not depend on bags, nodes or signals.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from cfd_pneumatic.lazy import loader_of

if TYPE_CHECKING:
    from cfd_pneumatic.messages.blocks import (
        NEVER,
        GroupingReader,
        MessageBlock,
        Span,
        earliest_after,
        gather,
        join,
        scatter,
    )
    from cfd_pneumatic.messages.decoding import CounterPath, Decoder, TimePaths
    from cfd_pneumatic.messages.definitions import FORMATS, Definitions
    from cfd_pneumatic.messages.fields import (
        FieldPath,
        Step,
        check_number,
        has_header,
        is_time,
        list_numbers,
        parse_path,
    )
    from cfd_pneumatic.messages.form import NANOSECOND, SECOND, Form
    from cfd_pneumatic.messages.layout import Layout, LayoutError, Place, Serialization
    from cfd_pneumatic.messages.types import NANOSECONDS, obvious_field, standard_types, types_with
    from cfd_pneumatic.messages.whole import LARGEST_MESSAGE, decode_whole
else:
    __getattr__ = loader_of(__name__)
