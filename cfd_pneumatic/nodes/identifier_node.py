"""`identifier_node`: `identify_bag` as a ROS service, with the result set on a running simulator."""

from __future__ import annotations

import json
import math
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rcl_interfaces.srv import GetParameters, SetParametersAtomically
from rclpy.client import Client
from rclpy.clock import Clock, ClockType
from rclpy.exceptions import InvalidTopicNameException
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.task import Future
from rclpy.validate_topic_name import validate_topic_name
from std_msgs.msg import String
from std_srvs.srv import Trigger

from cfd_pneumatic import convention
from cfd_pneumatic.commands.identify_bag import PROGRESS_KEY
from cfd_pneumatic.commands.program import BAD_INPUT
from cfd_pneumatic.errors import InputError
from cfd_pneumatic.identification.report import PARAMETER_FILE, REPORT_FILE
from cfd_pneumatic.model import NAMES
from cfd_pneumatic.nodes.health import diagnostics
from cfd_pneumatic.nodes.messages import OUTPUT_QOS
from cfd_pneumatic.nodes.parameters import number, switch, text, texts
from cfd_pneumatic.nodes.program import run

_PERIOD = 0.1  # how often the fit's process is looked after [s]
_POLL = 0.01  # [s]
_PATIENCE = 1.5  # what an interrupted fit is given to end by itself [s]
_ASK_AGAIN = 1.0  # a request to set or get parameters is repeated after this time [s]
_SERVICE_WAIT = 5.0  # how long a target of `apply_to` may take to appear or answer [s]
CANCELLED = 'cancelled: earlier outputs are untouched'
_LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


class FitProcess:
    """`identify_bag` in a process of its own, so that a long fit delays no callback and can be ended at once."""

    def __init__(self, arguments: Sequence[str]) -> None:
        """Start it."""
        self.what = 'starting'
        self.share = 0.0
        self._errors: list[str] = []
        self._kill_at = math.inf
        # a group of its own: an interrupt at the terminal reaches the node, which then ends the fit
        self._process = subprocess.Popen(
            [sys.executable, '-m', 'cfd_pneumatic.commands.identify_bag', '--progress=lines', *arguments],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            env=os.environ | {'PYTHONUNBUFFERED': '1'},
            start_new_session=True,
        )
        readers = (self._read_progress, self._read_errors)
        self._readers = [threading.Thread(target=read, daemon=True) for read in readers]
        for reader in self._readers:
            reader.start()

    def _read_progress(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            progress = json.loads(line)
            self.share, self.what = progress[PROGRESS_KEY], progress['what']

    def _read_errors(self) -> None:
        assert self._process.stderr is not None
        self._errors.extend(line.rstrip() for line in self._process.stderr)

    def ended(self) -> bool:
        """Tell whether it has ended; one that does not heed its cancellation in time is ended by force."""
        if time.monotonic() > self._kill_at:
            self._process.kill()
            self._process.wait()
        return self._process.poll() is not None

    def failure(self) -> str | None:
        """Return why it failed, or None where it succeeded; to be called once it has ended."""
        for reader in self._readers:
            reader.join()
        if self._process.returncode == 0:
            return None
        if self._kill_at < math.inf:
            return CANCELLED
        if self._process.returncode == BAD_INPUT and self._errors:
            return self._errors[-1]
        print('\n'.join(self._errors), file=sys.stderr)
        return f'identify_bag ended with code {self._process.returncode}: what it wrote stands on the terminal'

    def cancel(self) -> None:
        """Ask it to end; outputs are written whole or not at all."""
        if self._kill_at == math.inf:
            self._kill_at = time.monotonic() + _PATIENCE
            self._process.send_signal(signal.SIGINT)

    def end(self) -> None:
        """Cancel it and wait until it has ended."""
        self.cancel()
        while not self.ended():
            time.sleep(_POLL)


@dataclass(frozen=True)
class Job:
    """
    What to identify, as the parameters were when it was asked for.

    Attributes
    ----------
    arguments
        Of `identify_bag`.
    folder
        Where the results go.
    target
        Node that gets the parameters, or ''.

    """

    arguments: Sequence[str]
    folder: Path
    target: str


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
        declare('split', '60/20/20', text('percent of train, validation and test'))
        self._job: Job | None = None
        self._fit: FitProcess | None = None
        self._transfer: ParameterTransfer | None = None
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

    def _make_job(self) -> Job:
        """Return what the parameters ask for, or raise InputError where one is missing."""
        bags = [bag for bag in self._value('bags') if bag]
        output, target = self._value('output_dir'), self._value('apply_to')
        if not bags:
            raise InputError("parameter 'bags' is empty: name at least one bag")
        if not output:
            raise InputError("parameter 'output_dir' is empty: name the folder for the results")
        for path in bags:
            if not Path(path).exists():
                raise InputError(f"{path} (parameter 'bags') does not exist: give the path of a bag")
        if target:
            try:
                validate_topic_name(target)
            except InvalidTopicNameException as error:
                raise InputError(
                    f"parameter 'apply_to' is {target!r}: give a node's name, /cfd/sim/sim_node"
                ) from error
        arguments = [
            f'--output={output}',
            f'--split={self._value("split")}',
            f'--ambient-pressure={self._value("ambient_pressure")!r}',
        ]
        arguments += [f'--{name}={self._value(name)}' for name in ('mapping', 'namespace') if self._value(name)]
        if self._value('per_setpoint'):
            arguments.append('--per-setpoint')
        return Job([*arguments, '--', *bags], Path(output), target)

    def _on_identify(self, _request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        if self._job is not None:
            response.message = 'refused: an identification is running; ~/cancel ends it'
            return response
        try:
            self._job = self._make_job()
        except InputError as error:
            response.message = f'refused: {error}'
            return response
        self._fit = FitProcess(self._job.arguments)
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
        if self._job is None:
            return
        if self._fit is not None:
            if not self._fit.ended():
                return
            failure = self._fit.failure()
            self._fit = None
            if failure is not None:
                self._finish(DiagnosticStatus.WARN if failure == CANCELLED else DiagnosticStatus.ERROR, failure)
                return
            self._result_out.publish(String(data=(self._job.folder / REPORT_FILE).read_text(encoding='utf-8')))
            if not self._job.target:
                self._finish(DiagnosticStatus.OK, f'done: {self._job.folder / REPORT_FILE}')
                return
            self._transfer = ParameterTransfer(self, self._job.target, self._job.folder / PARAMETER_FILE)
            self._tell(DiagnosticStatus.OK, f'setting the parameters on {self._job.target}')
        elif self._transfer is not None:
            outcome = self._transfer.proceed()
            if outcome is not None:
                self._transfer.close()
                self._transfer = None
                self._finish(*outcome)

    def _finish(self, level: bytes, message: str) -> None:
        self._job = None
        self._tell(level, message)

    def _tell(self, level: bytes, message: str) -> None:
        self._status = (level, message)
        if level == DiagnosticStatus.OK:
            self.get_logger().info(message)
        elif level == DiagnosticStatus.WARN:
            self.get_logger().warning(message)
        else:
            self.get_logger().error(message)
        self._publish_diagnostics()

    def _publish_diagnostics(self) -> None:
        level, message = self._status
        values = {}
        if self._fit is not None:
            message = self._fit.what
            values['progress [%]'] = f'{100.0 * self._fit.share:.0f}'
        self._diagnostics_out.publish(diagnostics(self, 'identification', level, message, values))

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
        self._deadline = time.monotonic() + _SERVICE_WAIT
        found = yaml.safe_load(file.read_text(encoding='utf-8'))['/**']['ros__parameters']
        cylinders = [cylinder for cylinder in convention.CYLINDERS if cylinder in found]
        self._names = [f'{cylinder}.{name}' for cylinder in cylinders for name in ('setpoints', *NAMES)]
        self._fitted = {
            f'{cylinder}.{name}': [float(value) for value in found[cylinder][name]]
            for cylinder in cylinders
            for name in ('setpoints', *NAMES)
            if name in found[cylinder]
        }
        self._get = node.create_client(GetParameters, f'{self._target}/get_parameters')
        self._set = node.create_client(SetParametersAtomically, f'{self._target}/set_parameters_atomically')
        self._present: Future | None = None
        self._outcome: Future | None = None
        self._asked = 0.0

    def _ask(self, client: Client, request: object) -> Future:
        self._asked = time.monotonic()
        return client.call_async(request)

    def _unanswered(self) -> bool:
        """Tell whether to ask again: a reply is lost if it leaves before its sender has discovered this client."""
        return time.monotonic() - self._asked > _ASK_AGAIN

    def proceed(self) -> tuple[bytes, str] | None:
        """Go on as far as possible; return level and message when it has ended."""
        if self._present is None:
            if self._get.service_is_ready() and self._set.service_is_ready():
                self._present = self._ask(self._get, GetParameters.Request(names=self._names))
        elif self._outcome is None:
            if self._present.done():
                present = [list(value.double_array_value) for value in self._present.result().values]
                if len(present) < len(self._names) or not all(present):
                    return DiagnosticStatus.ERROR, f'{self._target} (parameter apply_to) is no sim_node'
                self._request = self._request_from(dict(zip(self._names, present)))
                self._outcome = self._ask(self._set, self._request)
            elif self._unanswered():
                self._present = None
        elif self._outcome.done():
            result = self._outcome.result().result
            if result.successful:
                return DiagnosticStatus.OK, f'parameters set on {self._target}'
            return DiagnosticStatus.ERROR, f'{self._target} refused the parameters: {result.reason}'
        elif self._unanswered():
            self._outcome = self._ask(self._set, self._request)
        if time.monotonic() > self._deadline:
            return DiagnosticStatus.ERROR, f'{self._target} (parameter apply_to) is not there: is its name right?'
        return None

    def _request_from(self, present: dict[str, list[float]]) -> SetParametersAtomically.Request:
        values = dict(self._fitted)
        for name in self._names:
            if name not in values:
                setpoints = f'{name.split(".")[0]}.setpoints'
                values[name] = np.interp(values[setpoints], present[setpoints], present[name]).tolist()
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
