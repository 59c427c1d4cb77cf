# SPDX-License-Identifier: Apache-2.0
"""Document every key of a mapping file: make interface-document writes docs/reference/mapping.md."""

from __future__ import annotations

from collections.abc import Mapping

from cfd_pneumatic.recording import COLUMN_KEYS, NUMBER_KEYS, PRESSURE_KEYS, TABLE_KEYS, TOP_KEYS, TOPIC_KEYS
from cfd_pneumatic.units import UNITS
from studies.documents.markdown import code, table
from studies.tools.provenance import ROOT

DOCUMENT = ROOT / 'docs' / 'reference' / 'mapping.md'
EXAMPLE = ROOT / 'config' / 'pneumatic_actuator.yaml'

BAG = """displacement:
  topic: /press/axes
  field: axes[0].position
  unit: inch
  scale: 1/3.1736            # inches in a volt
  offset: -0.5
  sign: -1                   # the reading falls while the volume of cylinder A grows
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

A mapping file describes the place and the unit of each signal in a table, or in a bag with different topics. The file
is YAML with an entry for each signal. `csv_to_bag`, `identify_bag --mapping` and `read_recording` read mapping files. A
number is converted to sign × (scale × raw + offset) in its unit. The displacement and the pressure of one cylinder are
required; all other signals are optional. If a unit, a sign or a reference (gauge or absolute) is not known, try a
value. The programs print each signal in SI units first, and warn about likely input errors.

`make interface-document` writes this page from the keys in the code.

## A table

`{example}`:

```yaml
{table_example}```

All rows and the header have the same number of fields. Numbers have decimal points, unless `table` has
`decimal: comma`. The file is UTF-8, UTF-16 or Latin-1.

## A bag

```yaml
{bag}```

## Keys

{tables}

A `setpoint` acts from its time on. A `setpoint_applied` acted from the time of the previous message up to its time.
Without both, the set-point is estimated as a constant.

## Units

{units}
"""


def document() -> str:
    """Return the page."""
    tables = {
        'Keys of the file': TOP_KEYS,
        'Keys of every signal': NUMBER_KEYS,
        'Additional keys of a pressure or a set-point': PRESSURE_KEYS,
        'Additional keys of a signal in a table': COLUMN_KEYS,
        'Additional keys of a signal in a bag': TOPIC_KEYS,
        'Keys of `table`': TABLE_KEYS,
    }
    return PAGE.format(
        example=EXAMPLE.relative_to(ROOT),
        table_example=EXAMPLE.read_text(encoding='utf-8'),
        bag=BAG,
        tables='\n\n'.join(f'{title}:\n\n{_keys(keys)}' for title, keys in tables.items()),
        units=_units(),
    )


def _keys(keys: Mapping[str, str]) -> str:
    return table(['key', 'meaning'], ([code(key), text] for key, text in keys.items()))


def _units() -> str:
    quantities = dict.fromkeys(unit.quantity for unit in UNITS.values())
    rows = (
        [quantity, ', '.join(code(name) for name, unit in UNITS.items() if unit.quantity == quantity)]
        for quantity in quantities
    )
    return table(['quantity', 'units'], rows)
