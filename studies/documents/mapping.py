# SPDX-License-Identifier: Apache-2.0
"""Every key of a mapping file: make interface-document writes docs/mapping.md."""

from __future__ import annotations

from collections.abc import Mapping

from cfd_pneumatic.recording import COLUMN_KEYS, NUMBER_KEYS, PRESSURE_KEYS, TABLE_KEYS, TOP_KEYS, TOPIC_KEYS
from cfd_pneumatic.units import UNITS
from studies.documents.markdown import code, table
from studies.tools.provenance import ROOT

DOCUMENT = ROOT / 'docs' / 'mapping.md'
EXAMPLE = ROOT / 'config' / 'pneumatic_actuator.yaml'

BAG = """displacement:
  topic: /press/axes
  field: axes[0].position
  unit: inch
  scale: 1/3.1736            # inches in a volt
  offset: -0.5
  sign: -1                   # the sensor's reading falls while cylinder A grows
cylinder_a:
  pressure:
    topic: /press/analog
    field: data[3]
    unit: psi
    scale: 25/5              # 25 psi in 5 V
    reference: gauge
    time_offset: -0.002
    stamp: t_us
    stamp_unit: us
  setpoint: {topic: /press/regulator, unit: bar, reference: gauge}
cylinder_b:
  pressure: {topic: /press/pressure_b, unit: Pa, reference: absolute}
force: {topic: /press/load_cell, field: wrench.force.z, unit: N}
others:
  tool_force: {topic: /press/second_cell, unit: N}
"""

PAGE = """# Mapping files

A mapping file says where a table or a bag of another make keeps the signals, and in which units. It is YAML, with an
entry for each signal. `csv_to_bag`, `identify_bag --mapping` and `read_recording` take it. A number becomes
sign × (scale × raw + offset) in its unit. The displacement and the pressure of one cylinder are needed; the rest is
optional. What is not known (a unit, a sign, gauge or absolute) is best tried: the programs print each signal in SI
units before anything else, and say what looks like a mistake.

The keys below are those of the code: `make interface-document` writes this page.

## A table

`{example}`:

```yaml
{table_example}```

All rows have the same number of fields, as many as the header has names. Numbers have decimal points, unless `table`
has `decimal: comma`. The file is UTF-8, UTF-16 or Latin-1.

## A bag

```yaml
{bag}```

## Keys

{tables}

A `setpoint` acts from its time on; a `setpoint_applied` acted up to its time, since the one before. Without either the
set-point is taken to be constant, and estimated.

## Units

{units}
"""


def document() -> str:
    """Return the page."""
    tables = {
        'Of the file': TOP_KEYS,
        'Of every signal': NUMBER_KEYS,
        'Of a pressure or a set-point, too': PRESSURE_KEYS,
        'Of a signal in a table, too': COLUMN_KEYS,
        'Of a signal in a bag, too': TOPIC_KEYS,
        'Of `table`': TABLE_KEYS,
    }
    return PAGE.format(
        example=EXAMPLE.relative_to(ROOT),
        table_example=EXAMPLE.read_text(encoding='utf-8'),
        bag=BAG,
        tables='\n\n'.join(f'{title}:\n\n{_keys(keys)}' for title, keys in tables.items()),
        units=_units(),
    )


def _keys(keys: Mapping[str, str]) -> str:
    return table(['key', 'what it says'], ([code(key), text] for key, text in keys.items()))


def _units() -> str:
    quantities = dict.fromkeys(one.quantity for one in UNITS.values())
    rows = ([what, ', '.join(code(name) for name, one in UNITS.items() if one.quantity == what)] for what in quantities)
    return table(['quantity', 'units'], rows)
