# SPDX-License-Identifier: Apache-2.0
"""`identifier_node`: `identify_bag` as a ROS service; the result is set on a running simulator."""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.clock import Clock, ClockType
from rclpy.exceptions import InvalidTopicNameException
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.validate_topic_name import validate_topic_name
from std_msgs.msg import String
from std_srvs.srv import Trigger

from cfd_pneumatic import convention
from cfd_pneumatic.device import DESCRIPTORS, NO_NAMES, Device, Value
from cfd_pneumatic.errors import InputError, printable, without_quotations
from cfd_pneumatic.identification import AUTO, CORES, sentence, title
from cfd_pneumatic.nodes.bounded_node import BoundedNode
from cfd_pneumatic.nodes.fit_process import CANCELLED, FitProcess
from cfd_pneumatic.nodes.folders import INPUTS, OUTPUT, Folders
from cfd_pneumatic.nodes.health import diagnostics
from cfd_pneumatic.nodes.messages import OUTPUT_QOS
from cfd_pneumatic.nodes.parameter_transfer import SERVICES, ParameterTransfer
from cfd_pneumatic.nodes.parameters import given_value, number, switch, text, texts
from cfd_pneumatic.nodes.program import run
from cfd_pneumatic.recording import read_mapping
from cfd_pneumatic.reporting import PAGE_FILE, PARAMETER_FILE, REPORT_FILE

_PERIOD = 0.1  # period of the checks of the fit's process [s]
_MOST_BAGS = 100  # each bag is checked before the fit starts, and no request is answered during the checks
_SWITCHES = ('per_setpoint', 'close_loop', 'overwrite')  # parameters that are options of `identify_bag`, too
_BUSY = 'refused: an identification is running; ~/cancel ends it'
_LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


@dataclass(frozen=True)
class Job:
    """
    An identification with the parameters at the time of the request.

    Attributes
    ----------
    arguments
        Arguments of `identify_bag`.
    folder
        Folder for the results.
    target
        Node whose parameters are set, or ''.

    """

    arguments: Sequence[str]
    folder: Path
    target: str


class IdentifierNode(BoundedNode):
    """
    Identifies bags on request.

    Services: `~/identify`, `~/cancel` and `~/revert` (std_srvs/Trigger). The report is on the latched topic `~/result`
    (std_msgs/String, JSON), progress and verdicts are on `/diagnostics`. With `close_loop` the report names physical
    effects that the model lacks. With `apply_to` the parameters and effects are set on another node.
    """

    def __init__(self, **kwargs: Any) -> None:
        """Declare parameters and offer the services."""
        super().__init__('identifier_node', **kwargs)
        self._declare_parameters()
        self._folders = Folders([folder for folder in self._value(INPUTS) if given_value(folder)], self._value(OUTPUT))
        for parameter in self._folders.missing:
            self.get_logger().warning(
                f'requests are refused: the node was started in the home folder or above it, and {parameter} is not '
                f'given. Start the node with -p {parameter}:=...'
            )
        self._job: Job | None = None
        self._fit: FitProcess | None = None
        self._transfer: ParameterTransfer | None = None
        self._status = (DiagnosticStatus.OK, 'idle')
        self._report: dict[str, Any] = {}
        self._earlier: tuple[str, dict[str, Value]] = ('', {})
        self._result_out = self.create_publisher(String, convention.RESULT, _LATCHED)
        self._diagnostics_out = self.create_publisher(DiagnosticArray, convention.DIAGNOSTICS, OUTPUT_QOS)
        self.create_service(Trigger, '~/identify', self._on_identify)
        self.create_service(Trigger, '~/cancel', self._on_cancel)
        self.create_service(Trigger, '~/revert', self._on_revert)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(_PERIOD, self._advance, clock=steady)
        self.create_timer(1.0, self._publish_diagnostics, clock=steady)

    def _declare_parameters(self) -> None:
        declare = self.declare_parameter
        declare(
            INPUTS,
            [''],
            texts(
                'folders below which bags and mapping must be; empty: the working folder, '
                'unless it is the home folder or above it',
                read_only=True,
            ),
        )
        declare(
            OUTPUT,
            '',
            text(
                'folder below which output_dir must be; empty: the working folder, '
                'unless it is the home folder or above it',
                read_only=True,
            ),
        )
        declare(
            'overwrite', False, switch('replace files in output_dir that this program did not write', read_only=True)
        )
        declare('bags', [''], texts('paths of the bags to identify jointly, below input_folders'))
        declare(
            'output_dir',
            '',
            text('folder for report.json, parameters.yaml and, with close_loop, report.html; below output_folder'),
        )
        declare('mapping', '', text('mapping file for bags of other topics, below input_folders; none: no mapping'))
        declare('namespace', '', text('namespace of the device if a bag holds several devices; empty: the only device'))
        declare('per_setpoint', False, switch('fit a table of operating points'))
        declare(
            'close_loop',
            False,
            switch('find physical effects that explain the remaining error of the pressure, and add them to the model'),
        )
        declare(
            'core',
            AUTO,
            text(f'equations to which effects are added: {", ".join(CORES)}; auto: chosen from the recordings'),
        )
        declare(
            'tolerance',
            '',
            text('acceptable error: 300Pa, 2N, 1% of the span, or several, as 300Pa,2N; none: every error matters'),
        )
        declare(
            'ambient_pressure',
            convention.AMBIENT_PRESSURE,
            number('Pa', 1e4, 2e5, 'absolute pressure that gauge pressures refer to'),
        )
        declare(
            'area',
            0.0,
            number(
                'm^2',
                0.0,
                convention.AREAS[1],
                'area of either piston, used if a measured force at a single set-point does not determine it; '
                '0: not known, computed from that force',
            ),
        )
        declare(
            'geometric_factor',
            0.0,
            number(
                '-',
                *convention.FACTORS,
                'contact force over piston force, from the linkage; 0: not known, included in the area',
            ),
        )
        declare('apply_to', '', text('node on which the result is set, e.g. /cfd/sim/sim_node; none: no node'))
        declare('split', '60/20/20', text('percent of train, validation and test'))

    def _value(self, name: str) -> Any:
        return given_value(self.get_parameter(name).value)

    def _make_job(self) -> Job:
        """Return the job that the parameters describe; raise InputError if a parameter is missing."""
        bags = [bag for bag in self._value('bags') if given_value(bag)]
        output, target = self._value('output_dir'), self._value('apply_to')
        if not bags:
            raise InputError("parameter 'bags' is empty: name at least one bag")
        if len(bags) > _MOST_BAGS:
            raise InputError(f"parameter 'bags' names {len(bags)} bags: name at most {_MOST_BAGS}")
        if not output:
            raise InputError("parameter 'output_dir' is empty: name the folder for the results")
        self._check_paths(bags, self._value('mapping'), output)
        if target:
            try:
                validate_topic_name(target)
                for service in SERVICES.values():
                    self.resolve_service_name(f'{target.rstrip("/")}/{service}')
            except (InvalidTopicNameException, RuntimeError) as error:
                raise InputError(
                    f"parameter 'apply_to' is {target!r}: give a node's name, /cfd/sim/sim_node"
                ) from error
        arguments = [
            f'--output={output}',
            f'--split={self._value("split")}',
            f'--core={self._value("core")}',
            f'--ambient-pressure={self._value("ambient_pressure")!r}',
        ]
        optional = ('mapping', 'namespace', 'area', 'geometric_factor')
        arguments += [f'--{name.replace("_", "-")}={self._value(name)}' for name in optional if self._value(name)]
        arguments += [f'--tolerance={tolerance}' for tolerance in self._value('tolerance').split(',') if tolerance]
        arguments += [f'--{name.replace("_", "-")}' for name in _SWITCHES if self._value(name)]
        return Job([*arguments, '--', *bags], Path(output), target)

    def _check_paths(self, bags: Sequence[str], mapping: str, output: str) -> None:
        """Check that all paths are below the folders that the node may read or write."""
        for path in dict.fromkeys([*bags, *([mapping] if mapping else [])]):
            self._folders.check_readable(path)
        types = read_mapping(mapping).types if mapping else None
        if types is not None:
            self._folders.check_readable(str(types))
        self._folders.check_writable(output)

    def _on_identify(self, _request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Start the identification that the parameters describe; refuse while an identification runs."""
        if self._is_busy:
            response.message = _BUSY
            return response
        try:
            job = self._make_job()
            self._fit = FitProcess(job.arguments)
        except (InputError, OSError) as error:  # a path may be too long for the system
            response.message = f'refused: {without_quotations(str(error))}'
            return response
        self._job = job
        self._report = {}
        self._set_status(DiagnosticStatus.OK, 'identifying')
        response.success = True
        response.message = 'accepted: the report will be published on ~/result'
        return response

    def _on_cancel(self, _request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Cancel the running identification; earlier outputs stay."""
        if self._fit is None:
            response.message = 'nothing is running'
            return response
        self._fit.cancel()
        response.success = True
        response.message = 'the fit is being ended; earlier outputs stay'
        return response

    def _on_revert(self, _request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Set the earlier parameters of `apply_to`; a second request restores the present parameters."""
        target, earlier = self._earlier
        if self._is_busy:
            response.message = _BUSY
        elif not earlier:
            response.message = 'nothing to revert: no parameters were set'
        else:
            self._transfer = ParameterTransfer(self, target, earlier)
            self._set_status(DiagnosticStatus.OK, f'reverting the parameters of {target}')
            response.success = True
            response.message = f'the earlier parameters are being set on {target}'
        return response

    @property
    def _is_busy(self) -> bool:
        return self._job is not None or self._transfer is not None

    def _advance(self) -> None:
        """Advance the fit or the setting of parameters by a step."""
        if self._fit is not None and self._job is not None:
            if self._fit.has_ended():
                self._take_results(self._fit, self._job)
        elif self._transfer is not None:
            outcome = self._transfer.advance()
            if outcome is not None:
                self._transfer.close()
                self._earlier = self._transfer.target, self._transfer.earlier
                self._transfer = None
                level, message = outcome
                self._finish(level, self._summary(message) if self._job is not None else message)

    def _take_results(self, fit: FitProcess, job: Job) -> None:
        """Publish the results of an ended fit, and set the parameters on the target if there is a target."""
        self._fit = None
        failure = fit.failure()
        if failure is not None:
            self._finish(DiagnosticStatus.WARN if failure == CANCELLED else DiagnosticStatus.ERROR, failure)
            return
        try:
            text, device = fit.load_results(job.folder)
        except InputError as error:
            self._finish(DiagnosticStatus.ERROR, without_quotations(str(error)))
            return
        self._report = json.loads(text)
        self._result_out.publish(String(data=text))
        if not job.target:
            self._finish(DiagnosticStatus.OK, self._summary('done'))
            return
        wanted = _with_other_effects_off(device, self._report)
        remedy = f': start it with {job.folder / PARAMETER_FILE}'
        self._transfer = ParameterTransfer(self, job.target, wanted, remedy)
        self._set_status(DiagnosticStatus.OK, f'setting the parameters on {job.target}')

    def _verdicts(self) -> dict[str, dict[str, Any]]:
        """Return the report's blocks of cylinders and force with a verdict, by name."""
        blocks = dict(self._report.get('cylinders', {}))
        if 'force' in self._report:
            blocks['force'] = self._report['force']
        return {name: block for name, block in blocks.items() if 'verdict' in block}

    def _summary(self, message: str) -> str:
        """Return a message with the verdict on each cylinder and the path of the report."""
        assert self._job is not None
        verdicts = self._verdicts()
        sentences = [f'{title(name)}: {sentence(block["why"])}' for name, block in verdicts.items()]
        page = self._job.folder / (PAGE_FILE if verdicts else REPORT_FILE)
        return ' '.join([f'{message}.', *sentences, f'See {page}'])

    def _finish(self, level: bytes, message: str) -> None:
        self._job = None
        self._set_status(level, message)

    def _set_status(self, level: bytes, message: str) -> None:
        message = printable(message)  # a path may contain line breaks
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
            message = self._fit.step
            values['progress [%]'] = f'{100.0 * self._fit.progress:.0f}'
        for name, block in self._verdicts().items():
            values[f'{name} verdict'] = block['verdict']
            values[f'{name} effects'] = ', '.join(block['effects']) or 'none'
        self._diagnostics_out.publish(diagnostics(self, 'identification', level, message, values))

    def destroy_node(self) -> None:
        """End a running fit."""
        if self._fit is not None:
            self._fit.end()
        super().destroy_node()


def _with_other_effects_off(device: Device, report: Mapping[str, Any]) -> dict[str, Value]:
    """Return a device's parameters, with every effect switched off that was not found."""
    identified = [*report['cylinders'], *([convention.CONTACT_FORCE] if 'force' in report else [])]
    switches = [name for name in DESCRIPTORS if name.count('.') == 2 and name.endswith('.enabled')]
    off: dict[str, Value] = {name: False for name in switches if name.partition('.')[0] in identified}
    not_identifiable: dict[str, Value] = {f'{name}.not_identifiable': NO_NAMES for name in report['cylinders']}
    return {**off, **not_identifiable, **device.given}


main = partial(run, 'identifier_node', IdentifierNode)

if __name__ == '__main__':
    sys.exit(main())
