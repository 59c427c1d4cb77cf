# SPDX-License-Identifier: Apache-2.0
"""
An example for each program, as its `--help` shows it and as a shell runs it.

The examples run in this order in a folder; the tests run them.
"""

from __future__ import annotations

from collections.abc import Mapping

EXAMPLES: Mapping[str, str] = {
    'compile_kernels': """\
compile_kernels
""",
    'record_rig': """\
record_rig out_and_back --device paper --faults effects_a.leak_conductance=1e-10 --output rig_bag
""",
    'identify_bag': """\
identify_bag rig_bag --close-loop --output rig_identified
""",
    'plan_experiment': """\
plan_experiment rig_identified/parameters.yaml --report rig_identified/report.json --output planned \\
    --stroke 3e-3 --speed 0.1 --pressures 35e3 70e3 --duration 20 --wanted k_v leakage lost_motion
record_rig planned/schedule.csv --output planned_bag
""",
    'force_on_path': """\
awk 'BEGIN {
    print "along_mm,error_mm"
    for (k = 0; k <= 400; k++) printf "%d,%.4f\\n", k, 0.002 * k + 0.2 * sin(k / 9)
}' > surface.csv
force_on_path surface.csv --device rig_identified --force 20N --feed 50mm/s --tolerance 10% --hold --output preview
record_rig preview/schedule.csv --device paper --output preview_bag
""",
    'csv_to_bag': """\
cat > press.csv <<END
t_ms,stroke_mm,p_psi,set_psi,load_N
0,0.00,10.00,10,31.0
2,0.01,9.97,10,30.9
4,0.03,9.91,10,30.7
END
cat > press.yaml <<END
table: {time: {column: t_ms, unit: ms}, delimiter: comma, header_rows: 1}
displacement: {column: stroke_mm, unit: mm, sign: 1}  # -1 if it is counted the other way
cylinder_a:  # likewise cylinder_b, if there is a second cylinder
  pressure: {column: p_psi, unit: psi, reference: gauge}  # or absolute
  setpoint: {column: set_psi, unit: psi, reference: gauge}
force: {column: load_N, unit: N}
END
csv_to_bag press.csv --mapping press.yaml --output press_bag
""",
    'leak_test': """\
awk 'BEGIN {
    print "t_s,p_kPa"
    for (k = 0; k <= 1200; k++) printf "%.1f,%.3f\\n", 0.1 * k, 600 * exp(-4e-4 * k) + 0.2 * sin(k * k)
}' > decay.csv
cat > decay.yaml <<END
table: {time: {column: t_s, unit: s}, delimiter: comma, header_rows: 1}
cylinder_a: {pressure: {column: p_kPa, unit: kPa, reference: gauge}}
END
leak_test decay.csv --mapping decay.yaml --output decay_told
""",
    'dask_certificate': """\
dask_certificate certificate
""",
    'rig_node': """\
rig_node --ros-args -r __ns:=/cfd/device -p schedule:=surface_following -p repeat:=true
""",
    'sim_node': """\
sim_node --ros-args -r __ns:=/cfd/sim --params-file rig_identified/parameters.yaml \\
    -r piston_state:=/cfd/device/piston_state \\
    -r cylinder_a/setpoint:=/cfd/device/cylinder_a/setpoint \\
    -r cylinder_b/setpoint:=/cfd/device/cylinder_b/setpoint
""",
    'monitor_node': """\
monitor_node --ros-args -r __ns:=/cfd/monitor --params-file rig_identified/parameters.yaml \\
    -r piston_state:=/cfd/device/piston_state \\
    -r cylinder_a/setpoint:=/cfd/device/cylinder_a/setpoint \\
    -r cylinder_b/setpoint:=/cfd/device/cylinder_b/setpoint \\
    -r cylinder_a/pressure:=/cfd/device/cylinder_a/pressure \\
    -r cylinder_b/pressure:=/cfd/device/cylinder_b/pressure \\
    -r measured_force:=/cfd/device/measured_force
""",
    'recorder_node': """\
recorder_node --ros-args -p output:=cell_bag \\
    -p topics:=[/cfd/device/piston_state,/cfd/device/cylinder_a/pressure,/cfd/device/cylinder_b/pressure]
""",
    'identifier_node': """\
identifier_node --ros-args -r __ns:=/cfd -p bags:=[rig_bag] -p output_dir:=found -p close_loop:=true
""",
}
"""Examples by program."""


def example_of(program: str) -> str:
    """Return the example of a program, as the end of its help shows it."""
    return f'example:\n\n{EXAMPLES[program]}'
