"""`identifier_node`: `identify_bag` as a ROS service, with the result set on a running simulator."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rcl_interfaces.srv import GetParameters, SetParametersAtomically
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.task import Future
from std_msgs.msg import String
from std_srvs.srv import Trigger

from cfd_pneumatic import convention
from cfd_pneumatic.commands.identify_bag import PROGRESS_KEY
from cfd_pneumatic.errors import InputError
from cfd_pneumatic.identification.report import PARAMETER_FILE, REPORT_FILE
from cfd_pneumatic.model import NAMES
from cfd_pneumatic.nodes.messages import OUTPUT_QOS
from cfd_pneumatic.nodes.parameters import number, switch, text, texts
from cfd_pneumatic.nodes.program import run

_PERIOD = 0.1  # how often the fit's process is looked after [s]
_PATIENCE = 1.5  # what an interrupted fit is given to end by itself [s]
_SERVICE_WAIT = 5.0  # how long a target of `apply_to` may take to appear or answer [s]
_LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


class FitProcess:
    """`identify_bag` in a process of its own, so that a long fit delays no callback and can be ended at once."""

    def __init__(self, arguments: Sequence[str]) -> None:
        """Start it."""
        self.what = 'starting'
        self.share = 0.0
        self.cancelled = False
        self._errors: list[str] = []
        # a group of its own: an interrupt at the terminal reaches the node, which then ends the fit
        self._process = subprocess.Popen(
            [sys.executable, '-m', 'cfd_pneumatic.commands.identify_bag', *arguments, '--progress', 'lines'],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            env=os.environ | {'PYTHONUNBUFFERED': '1'},
            start_new_session=True,
        )
        self._readers = [threading.Thread(target=read, daemon=True) for read in (self._read_progress, self._read_errors)]
        for reader in self._readers:
            reader.start()

    def _read_progress(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            progress = json.loads(line)
            self.share, self.what = progress[PROGRESS_KEY], progress['what']

    def _read_errors(self) -> None:
        assert self._process.stderr is not None
        self._errors.extend(line.strip() for line in self._process.stderr)

    @property
    def running(self) -> bool:
        """Whether it has not ended yet."""
        return self._process.poll() is None

    def error(self) -> str | None:
        """Return why it failed, or None where it succeeded; to be called once it has ended."""
        for reader in self._readers:
            reader.join()
        if self.cancelled:
            return 'cancelled'
        if self._process.returncode == 0:
            return None
        return self._errors[-1] if self._errors else f'identify_bag ended with code {self._process.returncode}'

    def cancel(self) -> None:
        """Ask it to end; outputs are written whole or not at all."""
        self.cancelled = True
        self._process.send_signal(signal.SIGINT)

    def end(self) -> None:
        """End it, by force if need be."""
        if self.running:
            self.cancel()
            try:
                self._process.wait(_PATIENCE)
            except subprocess.TimeoutExpired:
                self._process.kill()
                self._process.wait()


class IdentifierNode(Node):
    """
    Identifies bags on request.

    Services `~/identify` and `~/cancel` (std_srvs/Trigger); the report on the latched topic `~/result`
    (std_msgs/String, JSON); progress on `/diagnostics`. With `apply_to` the fitted parameters are set on that node.
    """

    def __init__(self, **kwargs: Any) -> None:
        """Declare parameters and offer the services."""
        super().__init__('identifier_node', **kwargs)
        declare = self.declare_parameter
        declare('bags', [''], texts('paths of the bags to identify jointly'))
        declare('output_dir', '', text('folder for report.json and parameters.yaml'))
        declare('mapping', '', text('mapping file for bags with other topics; empty: the convention'))
        declare('namespace', '', text('namespace of the device where a bag holds several; empty: the only one'))
        declare('per_setpoint', False, switch('fit a table of operating points'))
        declare(
            'ambient_pressure',
            convention.AMBIENT_PRESSURE,
            number('Pa', 1e4, 2e5, 'absolute pressure that gauge pressures are counted from'),
        )
        declare('apply_to', '', text('node whose parameters the result sets, e.g. /cfd/sim/sim_node; empty: none'))
        self._fit: FitProcess | None = None
        self._applying: ParameterTransfer | None = None
        self._status = (DiagnosticStatus.OK, 'idle')
        self._result_out = self.create_publisher(String, '~/result', _LATCHED)
        self._diagnostics_out = self.create_publisher(DiagnosticArray, '/diagnostics', OUTPUT_QOS)
        self.create_service(Trigger, '~/identify', self._on_identify)
        self.create_service(Trigger, '~/cancel', self._on_cancel)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(_PERIOD, self._look_after, clock=steady)
        self.create_timer(1.0, self._publish_diagnostics, clock=steady)

    def _value(self, name: str) -> Any:
        return self.get_parameter(name).value

    def _arguments(self) -> list[str]:
        """Return identify_bag's arguments, or raise InputError where a parameter is missing."""
        bags = [bag for bag in self._value('bags') if bag]
        if not bags:
            raise InputError("parameter 'bags' is empty: name at least one bag")
        if not self._value('output_dir'):
            raise InputError("parameter 'output_dir' is empty: name the folder for the results")
        for path in bags:
            if not Path(path).exists():
                raise InputError(f"{path} (parameter 'bags') does not exist: give the path of a bag")
        arguments = ['--output', self._value('output_dir'), '--ambient-pressure', str(self._value('ambient_pressure'))]
        for name in ('mapping', 'namespace'):
            if self._value(name):
                arguments += [f'--{name}', self._value(name)]
        if self._value('per_setpoint'):
            arguments.append('--per-setpoint')
        return [*arguments, '--', *bags]

    def _on_identify(self, _request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        if self._fit is not None or self._applying is not None:
            response.message = 'refused: an identification is running; ~/cancel ends it'
            return response
        try:
            self._fit = FitProcess(self._arguments())
        except InputError as error:
            response.message = f'refused: {error}'
            return response
        self._tell(DiagnosticStatus.OK, 'identifying')
        response.success = True
        response.message = 'accepted: the report comes on ~/result'
        return response

    def _on_cancel(self, _request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        if self._fit is None:
            response.message = 'nothing is running'
            return response
        self._fit.cancel()
        response.success = True
        response.message = 'the fit is being ended; earlier outputs stay'
        return response

    def _look_after(self) -> None:
        """Follow the fit, then the setting of its parameters, one step at a time."""
        if self._fit is not None and not self._fit.running:
            error = self._fit.error()
            self._fit = None
            if error is None:
                self._finish()
            else:
                self._tell(DiagnosticStatus.WARN if error == 'cancelled' else DiagnosticStatus.ERROR, error)
        if self._applying is not None:
            outcome = self._applying.proceed()
            if outcome is not None:
                self._applying.close()
                self._applying = None
                self._tell(*outcome)

    def _finish(self) -> None:
        folder = Path(self._value('output_dir'))
        self._result_out.publish(String(data=(folder / REPORT_FILE).read_text(encoding='utf-8')))
        self._tell(DiagnosticStatus.OK, f'done: {folder / REPORT_FILE}')
        target = self._value('apply_to')
        if target:
            self._applying = ParameterTransfer(self, target, folder / PARAMETER_FILE)

    def _tell(self, level: bytes, message: str) -> None:
        self._status = (level, message)
        log = self.get_logger()
        if level == DiagnosticStatus.OK:
            log.info(message)
        else:
            log.error(message)
        self._publish_diagnostics()

    def _publish_diagnostics(self) -> None:
        name = self.get_fully_qualified_name()
        status = DiagnosticStatus(name=f'{name}: identification', hardware_id=name)
        status.level, status.message = self._status
        if self._fit is not None:
            status.message = self._fit.what
            status.values = [KeyValue(key='progress [%]', value=f'{100.0 * self._fit.share:.0f}')]
        message = DiagnosticArray(status=[status])
        message.header.stamp = self.get_clock().now().to_msg()
        self._diagnostics_out.publish(message)

    def destroy_node(self) -> None:
        """End a running fit."""
        if self._fit is not None:
            self._fit.end()
        super().destroy_node()


class ParameterTransfer:
    """
    Setting a parameter file on another node, all at once or not at all.

    A gain that was not identifiable stands in no file; it is taken from the target, at the new set-points, because its
    list has to be as long as theirs.
    """

    def __init__(self, node: Node, target: str, file: Path) -> None:
        """Begin; `proceed` does the rest without waiting."""
        self._node = node
        self._target = target.rstrip('/')
        self._steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._deadline = self._now() + _SERVICE_WAIT
        found = yaml.safe_load(file.read_text(encoding='utf-8'))['/**']['ros__parameters']
        self._values: dict[str, list[float]] = {
            f'{cylinder}.{name}': found[cylinder][name]
            for cylinder in convention.CYLINDERS
            for name in ('setpoints', *NAMES)
            if name in found.get(cylinder, {})
        }
        cylinders = [cylinder for cylinder in convention.CYLINDERS if cylinder in found]
        self._wanted = [f'{cylinder}.{name}' for cylinder in cylinders for name in ('setpoints', *NAMES)]
        self._get = node.create_client(GetParameters, f'{self._target}/get_parameters')
        self._set = node.create_client(SetParametersAtomically, f'{self._target}/set_parameters_atomically')
        self._asked: Future | None = None
        self._sent: Future | None = None

    def _now(self) -> float:
        return float(self._steady.now().nanoseconds) * 1e-9

    def proceed(self) -> tuple[bytes, str] | None:
        """Go on as far as possible; return level and message when it has ended."""
        if self._asked is None:
            if self._get.service_is_ready() and self._set.service_is_ready():
                self._asked = self._get.call_async(GetParameters.Request(names=self._wanted))
        elif self._sent is None:
            if self._asked.done():
                present = {
                    name: list(value.double_array_value)
                    for name, value in zip(self._wanted, self._asked.result().values)
                }
                if not all(present.values()):
                    return DiagnosticStatus.ERROR, f'{self._target} is not a sim_node: it lacks {self._wanted[0]}'
                self._sent = self._set.call_async(self._request(present))
        elif self._sent.done():
            result = self._sent.result().result
            if result.successful:
                return DiagnosticStatus.OK, f'parameters set on {self._target}'
            return DiagnosticStatus.ERROR, f'{self._target} refused the parameters: {result.reason}'
        if self._now() > self._deadline:
            return DiagnosticStatus.ERROR, f'{self._target} (parameter apply_to) is not there: is its name right?'
        return None

    def _request(self, present: dict[str, list[float]]) -> SetParametersAtomically.Request:
        values = dict(self._values)
        for name in self._wanted:
            if name not in values:
                cylinder = name.split('.')[0]
                setpoints = f'{cylinder}.setpoints'
                values[name] = list(map(float, np.interp(values[setpoints], present[setpoints], present[name])))
        parameters = [Parameter(name, Parameter.Type.DOUBLE_ARRAY, value) for name, value in values.items()]
        return SetParametersAtomically.Request(parameters=[one.to_parameter_msg() for one in parameters])

    def close(self) -> None:
        """Give the clients back."""
        self._node.destroy_client(self._get)
        self._node.destroy_client(self._set)


def main(args: Sequence[str] | None = None) -> None:
    """Run `identifier_node`."""
    sys.exit(run('identifier_node', IdentifierNode, args))


if __name__ == '__main__':
    main()
