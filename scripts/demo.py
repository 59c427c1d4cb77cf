"""
The main job on real input, for a first look: make demo.

The virtual rig and its simulator run in a ROS 2 graph and are recorded; the recording is identified, and so is a
measured run of a real cylinder where the measured data are.
"""

from __future__ import annotations

import argparse
import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path

from ros_environment import isolate

ROOT = Path(__file__).resolve().parents[1]
MEASURED_RUN = 'pneumatic_actuator/friction/O-ring257_3bar.csv'
CYLINDERS = ('cylinder_a', 'cylinder_b')
INPUTS = ('piston_state', *(f'{cylinder}/setpoint' for cylinder in CYLINDERS))
DEVICE_TOPICS = (
    'piston_state',
    *(f'{cylinder}/{topic}' for cylinder in CYLINDERS for topic in ('setpoint', 'setpoint_applied', 'pressure')),
    'measured_force',
)
SIMULATOR_TOPICS = (*(f'{cylinder}/pressure' for cylinder in CYLINDERS), 'contact_force')
PLAYING_TIME = 60.0  # the rig has to be done by then [s]; it plays for 6 s
ENDING_TIME = 10.0  # a node has to end by then [s]


def main() -> int:
    """Run the demo; return its exit code."""
    parser = argparse.ArgumentParser(prog='demo', description=__doc__)
    parser.add_argument('--output', type=Path, default=ROOT / 'demo_output', help='folder for all outputs')
    output = parser.parse_args().output
    isolate()
    shutil.rmtree(output, ignore_errors=True)
    output.mkdir(parents=True)

    heading('The device and its simulator in a ROS 2 graph')
    bag = output / 'rig_bag'
    run_graph(bag)

    heading('What the recording of the device tells')
    run('identify_bag', bag, '--namespace', '/cfd/device', '--output', output / 'rig_identified')

    heading('What a measured recording of a real cylinder tells')
    data = Path(os.environ.get('CFD_PNEUMATIC_DATA') or ROOT.parent / 'shared' / 'data')
    if (data / MEASURED_RUN).is_file():
        mapping = ROOT / 'config' / 'pneumatic_actuator.yaml'
        run('csv_to_bag', data / MEASURED_RUN, '--mapping', mapping, '--output', output / 'measured_bag')
        run('identify_bag', output / 'measured_bag', '--output', output / 'measured_identified')
    else:
        print(f'left out: {MEASURED_RUN} is not here; CFD_PNEUMATIC_DATA names the folder that it is in (see README)')

    print(f'\nAll outputs are in {output}')
    return 0


def heading(text: str) -> None:
    print(f'\n== {text}', flush=True)


def run(program: str, *arguments: object) -> None:
    """Run one of the offline programs; end the demo if it fails."""
    ended = subprocess.run(
        [sys.executable, '-m', f'cfd_pneumatic.commands.{program}', *map(str, arguments)], check=False
    )
    if ended.returncode != 0:
        raise SystemExit(ended.returncode)


def run_graph(bag: Path) -> None:
    """Let the rig play its schedule, the simulator follow it, and the recorder write both to a bag."""
    topics = [f'/cfd/device/{topic}' for topic in DEVICE_TOPICS] + [f'/cfd/sim/{topic}' for topic in SIMULATOR_TOPICS]
    remaps = [argument for topic in INPUTS for argument in ('-r', f'{topic}:=/cfd/device/{topic}')]
    followers = [
        start('sim_node', '-r', '__ns:=/cfd/sim', *remaps),
        start('recorder_node', '-p', f'output:={bag}', '-p', f'topics:=[{",".join(topics)}]'),
    ]
    # the schedule begins once simulator and recorder listen
    settings = ('schedule:=out_and_back', 'start_subscribers:=2', 'start_delay:=1.0', 'exit_when_done:=true')
    rig = start('rig_node', '-r', '__ns:=/cfd/device', *(part for setting in settings for part in ('-p', setting)))
    try:
        failed = rig.wait(PLAYING_TIME)
    finally:
        for node in (rig, *followers):
            if node.poll() is None:
                node.send_signal(signal.SIGINT)
        codes = [node.wait(ENDING_TIME) for node in followers]
    if failed or any(codes):
        raise SystemExit('demo: a node failed, see above')


def start(node: str, *arguments: str) -> subprocess.Popen[bytes]:
    return subprocess.Popen([sys.executable, '-m', f'cfd_pneumatic.nodes.{node}', '--ros-args', *arguments])


if __name__ == '__main__':
    sys.exit(main())
