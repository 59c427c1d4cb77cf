# SPDX-License-Identifier: Apache-2.0
"""`identifier_node`: `identify_bag` as a ROS service, with the result set on a running simulator."""

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
from cfd_pneumatic.nodes.parameters import number, switch, text, texts, value_of
from cfd_pneumatic.nodes.program import run
from cfd_pneumatic.recording import read_mapping
from cfd_pneumatic.reporting import PAGE_FILE, PARAMETER_FILE, REPORT_FILE

_PERIOD = 0.1  # how often the fit's process is looked after [s]
_MOST_BAGS = 100  # each is looked at before the fit starts, and no request is answered meanwhile
_SWITCHES = ('per_setpoint', 'close_loop', 'overwrite')  # parameters that are options of `identify_bag`, too
_BUSY = 'refused: an identification is running; ~/cancel ends it'
_LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


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


class IdentifierNode(BoundedNode):
    """
    Identifies bags on request.

    Services `~/identify` and `~/cancel` (std_srvs/Trigger); the report on the latched topic `~/result`
    (std_msgs/String, JSON); progress on `/diagnostics`, and in the end what was found. With `close_loop` that is also
    which physical effects the model lacks. With `apply_to` the parameters and effects are set on that node.
    """

    def __init__(self, **kwargs: Any) -> None:
        """Declare parameters and offer the services."""
        super().__init__('identifier_node', **kwargs)
        self._declare_parameters()
        self._folders = Folders([one for one in self._value(INPUTS) if value_of(one)], self._value(OUTPUT))
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
        self.create_timer(_PERIOD, self._look_after, clock=steady)
        self.create_timer(1.0, self._publish_diagnostics, clock=steady)

    def _declare_parameters(self) -> None:
        declare = self.declare_parameter
        declare(
            INPUTS,
            [''],
            texts(
                'folders below which bags and mapping have to be; empty: the working folder, '
                'unless it is the home folder or above it',
                read_only=True,
            ),
        )
        declare(
            OUTPUT,
            '',
            text(
                'folder below which output_dir has to be; empty: the working folder, '
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
        declare('namespace', '', text('namespace of the device where a bag holds several; empty: the only one'))
        declare('per_setpoint', False, switch('fit a table of operating points'))
        declare(
            'close_loop',
            False,
            switch('trace what the model leaves of the pressure to physical effects that it lacks, and add them to it'),
        )
        declare(
            'core',
            AUTO,
            text(f'equations that effects are sought beside: {", ".join(CORES)}; auto: what the recordings need'),
        )
        declare(
            'tolerance',
            '',
            text(
                'error that does not matter: 300Pa, 2N, 1% of the span, or some, as 300Pa,2N; none: every one matters'
            ),
        )
        declare(
            'ambient_pressure',
            convention.AMBIENT_PRESSURE,
            number('Pa', 1e4, 2e5, 'absolute pressure that gauge pressures are counted from'),
        )
        declare(
            'area',
            0.0,
            number(
                'm^2',
                0.0,
                convention.AREAS[1],
                'area of either piston, held where a measured force at one set-point does not tell it; 0: not known, '
                'what makes that force',
            ),
        )
        declare(
            'geometric_factor',
            0.0,
            number(
                '-',
                *convention.FACTORS,
                'contact force over piston force, from the linkage; 0: not known, it counts as a part of the area',
            ),
        )
        declare('apply_to', '', text('node whose parameters the result sets, e.g. /cfd/sim/sim_node; none: no node'))
        declare('split', '60/20/20', text('percent of train, validation and test'))

    def _value(self, name: str) -> Any:
        return value_of(self.get_parameter(name).value)

    def _make_job(self) -> Job:
        """Return what the parameters ask for, or raise InputError where one is missing."""
        bags = [bag for bag in self._value('bags') if value_of(bag)]
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
        given = ('mapping', 'namespace', 'area', 'geometric_factor')
        arguments += [f'--{name.replace("_", "-")}={self._value(name)}' for name in given if self._value(name)]
        arguments += [f'--tolerance={one}' for one in self._value('tolerance').split(',') if one]
        arguments += [f'--{name.replace("_", "-")}' for name in _SWITCHES if self._value(name)]
        return Job([*arguments, '--', *bags], Path(output), target)

    def _check_paths(self, bags: Sequence[str], mapping: str, output: str) -> None:
        """Check that what is read and written is where the node was started to read and write."""
        for path in dict.fromkeys([*bags, *([mapping] if mapping else [])]):
            self._folders.check_readable(path)
        types = read_mapping(mapping).types if mapping else None
        if types is not None:
            self._folders.check_readable(str(types))
        self._folders.check_writable(output)

    def _on_identify(self, _request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Begin to identify what the parameters name; refused while an identification runs."""
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
        self._tell(DiagnosticStatus.OK, 'identifying')
        response.success = True
        response.message = 'accepted: the report comes on ~/result'
        return response

    def _on_cancel(self, _request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """End the identification that runs; earlier outputs stay."""
        if self._fit is None:
            response.message = 'nothing is running'
            return response
        self._fit.cancel()
        response.success = True
        response.message = 'the fit is being ended; earlier outputs stay'
        return response

    def _on_revert(self, _request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Set what `apply_to` had before its parameters were set last; once more brings these back."""
        target, earlier = self._earlier
        if self._is_busy:
            response.message = _BUSY
        elif not earlier:
            response.message = 'nothing was set that could be taken back'
        else:
            self._transfer = ParameterTransfer(self, target, earlier)
            self._tell(DiagnosticStatus.OK, f'taking back the parameters of {target}')
            response.success = True
            response.message = f'the earlier parameters are being set on {target}'
        return response

    @property
    def _is_busy(self) -> bool:
        return self._job is not None or self._transfer is not None

    def _look_after(self) -> None:
        """Follow the fit, then the setting of parameters, one step at a time."""
        if self._fit is not None and self._job is not None:
            if self._fit.ended():
                self._take_results(self._fit, self._job)
        elif self._transfer is not None:
            outcome = self._transfer.proceed()
            if outcome is not None:
                self._transfer.close()
                self._earlier = self._transfer.target, self._transfer.earlier
                self._transfer = None
                level, message = outcome
                self._finish(level, self._found(message) if self._job is not None else message)

    def _take_results(self, fit: FitProcess, job: Job) -> None:
        """Publish what a fit that has ended found, and set the parameters on another node where that is asked for."""
        self._fit = None
        failure = fit.failure()
        if failure is not None:
            self._finish(DiagnosticStatus.WARN if failure == CANCELLED else DiagnosticStatus.ERROR, failure)
            return
        try:
            text, device = fit.results(job.folder)
        except InputError as error:
            self._finish(DiagnosticStatus.ERROR, without_quotations(str(error)))
            return
        self._report = json.loads(text)
        self._result_out.publish(String(data=text))
        if not job.target:
            self._finish(DiagnosticStatus.OK, self._found('done'))
            return
        wanted = _with_other_effects_off(device, self._report)
        remedy = f': start it with {job.folder / PARAMETER_FILE}'
        self._transfer = ParameterTransfer(self, job.target, wanted, remedy)
        self._tell(DiagnosticStatus.OK, f'setting the parameters on {job.target}')

    def _verdicts(self) -> dict[str, dict[str, Any]]:
        """Return what the report says on each cylinder, and on the force, where the loop was closed."""
        blocks = dict(self._report.get('cylinders', {}))
        if 'force' in self._report:
            blocks['force'] = self._report['force']
        return {name: block for name, block in blocks.items() if 'verdict' in block}

    def _found(self, message: str) -> str:
        """Return a message with the verdict on each cylinder, and where to read more."""
        assert self._job is not None
        verdicts = self._verdicts()
        sentences = [f'{title(name)}: {sentence(block["why"])}' for name, block in verdicts.items()]
        page = self._job.folder / (PAGE_FILE if verdicts else REPORT_FILE)
        return ' '.join([f'{message}.', *sentences, f'See {page}'])

    def _finish(self, level: bytes, message: str) -> None:
        self._job = None
        self._tell(level, message)

    def _tell(self, level: bytes, message: str) -> None:
        message = printable(message)  # a path may hold anything, a line of the log among it
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
    """Return a device's parameters, with every effect off that was looked for and not found."""
    identified = [*report['cylinders'], *([convention.CONTACT_FORCE] if 'force' in report else [])]
    switches = [name for name in DESCRIPTORS if name.count('.') == 2 and name.endswith('.enabled')]
    off: dict[str, Value] = {name: False for name in switches if name.partition('.')[0] in identified}
    told: dict[str, Value] = {f'{name}.not_identifiable': NO_NAMES for name in report['cylinders']}
    return {**off, **told, **device.given}


main = partial(run, 'identifier_node', IdentifierNode)

if __name__ == '__main__':
    sys.exit(main())
