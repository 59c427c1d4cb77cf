# SPDX-License-Identifier: Apache-2.0
"""Base of the nodes that run the device's model: parameters, set-points, samples of the piston."""

from __future__ import annotations

import math
import reprlib
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import partial
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rcl_interfaces.msg import SetParametersResult
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile
from std_msgs.msg import Float64

from cfd_pneumatic import convention
from cfd_pneumatic.convention import JOINT_STATE
from cfd_pneumatic.device import Device
from cfd_pneumatic.errors import InputError
from cfd_pneumatic.model import NAMES, DeviceModel, warm_up
from cfd_pneumatic.nodes.bounded_node import BoundedNode
from cfd_pneumatic.nodes.health import LARGE, LOST, MISMATCHED, REPEATED, WITHOUT_JOINT, InputHealth, diagnostics
from cfd_pneumatic.nodes.input_range import InputRange
from cfd_pneumatic.nodes.messages import AXES, COMMAND_QOS, OUTPUT_QOS, SAMPLE_QOS
from cfd_pneumatic.nodes.parameter_files import has_files, unread_files
from cfd_pneumatic.nodes.parameters import FRAME_LENGTH, checked_frame, declare_device, device_of, number, text
from cfd_pneumatic.nodes.publishers import (
    other_topics,
    publisher_names,
    several_publishers,
    type_name,
    unheard_publishers,
)
from cfd_pneumatic.nodes.samples import joint_reader
from cfd_pneumatic.nodes.topics import Backlog, subscribe, subscribe_latched
from cfd_pneumatic.runtime import announced

_FARTHEST = 1e3  # largest end of a stroke [m]; beyond, the model would leave floating point's range
_STROKE = 1.0  # no end effector's piston is farther from its origin [m]
_FEWEST_REPEATED = 3  # repeated stamps before a warning
_REPEATED_PER_SAMPLE = 20  # repeated stamps per new stamp before a warning: a fast driver may repeat each sample
_NAMES = reprlib.Repr()  # formats the joints of a message, of any number and length
_NAMES.maxlist, _NAMES.maxstring = 20, 80


class ModelNode(BoundedNode):
    """
    A node that runs the device's model; each parameter is described, with its unit, in its descriptor.

    A derived node implements `_commit` for a sample and `_apply_changes` for changed parameters.
    """

    def __init__(self, name: str, **kwargs: Any) -> None:
        """Declare parameters and compile the model."""
        super().__init__(name, **kwargs)
        self._health = InputHealth(self, convention.PISTON_STATE)
        self._samples = Backlog()
        self._subscribed: dict[str, tuple[str, QoSProfile]] = {}  # type and QoS of each topic
        self._shared_publishers: list[str] = []  # publishers of piston_state, if messages without the joint arrived
        self._diagnostics_out = self.create_publisher(DiagnosticArray, convention.DIAGNOSTICS, OUTPUT_QOS)
        axis = self._parameter_overrides.get('axis')
        if axis is not None and axis.value is True:  # YAML reads a bare y as true; `ros2 param dump` writes a bare y
            self._parameter_overrides['axis'] = Parameter('axis', value='y')
        self._declare_parameters()
        self._described_device = self._make_device({})
        self._cylinders = tuple(self._device.cylinders)
        self._refused_setpoints: dict[str, str] = {}  # warning by topic
        assumed = ['area', *(f'{cylinder}.{gain}' for cylinder in self._cylinders for gain in NAMES)]
        self._defaults = [name for name in assumed if name not in self._parameter_overrides]
        self._setpoints = {name: self._value(f'{name}.initial_setpoint') for name in convention.CYLINDERS}
        self._without_setpoint = set(self._cylinders)  # cylinders that wait for a first set-point
        self._range = InputRange(self._described_device.identified_range)
        self._compare_range()
        for cylinder in self._cylinders:
            refusal = self._setpoint_refusal(self._setpoints[cylinder])
            if refusal is not None:
                raise InputError(f'{cylinder}.initial_setpoint is {refusal}')
        self._apply_piston_parameters({})
        self._unread_files = list(unread_files(self))
        substitute = "the paper's Table 1 and the default area are used"
        if self._defaults == assumed:
            self.get_logger().info(
                f'no gains and no area are given: {substitute}. Pass --ros-args --params-file parameters.yaml'
            )
        elif self._defaults:
            self.get_logger().warning(f'not given: {self._listed_defaults()}; {substitute}')
        if self._described_device.not_identifiable:
            self.get_logger().warning(
                f'not identifiable: {self._listed_not_identifiable()}; the value assumed in the fit is used'
            )
        with announced(self._on_compiling, self._on_waiting):
            self._warm_up()

    def _warm_up(self) -> None:
        """Compile the model's kernels before the first sample."""
        warm_up()

    # parameters

    def _value(self, name: str, changes: Mapping[str, Any] | None = None) -> Any:
        if changes and name in changes:
            return changes[name]
        return self.get_parameter(name).value

    def _declare_parameters(self) -> None:
        declare = self.declare_parameter
        declare('joint', convention.PISTON_JOINT, text('name of the piston joint in piston_state'))
        declare('frame_id', 'cfd', text('frame of contact_force and of the pressures', FRAME_LENGTH))
        declare(
            'axis',
            'x',
            text(
                'axis of frame_id along which contact_force points',
                "x, 'y' (in quotes: YAML reads a bare y as true) or z",
            ),
        )
        declare(
            'stroke_lower',
            -_STROKE,
            number('m', -_FARTHEST, _FARTHEST, 'smallest displacement; a smaller value is refused'),
        )
        declare(
            'stroke_upper',
            _STROKE,
            number('m', -_FARTHEST, _FARTHEST, 'largest displacement; a larger value is refused'),
        )
        declare('hardware_id', '', text('serial number of the device, for /diagnostics; empty: the name of the node'))
        declare(
            'max_gap',
            1.0,
            number('s', 1e-3, 1e3, 'longest time between samples; after a longer gap the model starts anew'),
        )
        declare(
            'timeout', 0.5, number('s', 1e-2, 1e3, 'silence of piston_state after which /diagnostics reports an error')
        )
        declare_device(self)

    def _make_device(self, changes: Mapping[str, Any]) -> Device:
        if self._value('axis', changes) not in AXES:
            raise InputError(f'axis {self._value("axis", changes)!r} is not one of {", ".join(AXES)}')
        checked_frame(self._value('frame_id', changes))
        lower, upper = (self._value(f'stroke_{end}', changes) for end in ('lower', 'upper'))
        if not lower < upper:
            raise InputError(f'stroke_lower {lower:g} m is not below stroke_upper {upper:g} m')
        return device_of(self, changes)

    def _on_parameters(self, parameters: list[Parameter]) -> SetParametersResult:
        """Apply valid values from the next sample on; reject invalid values with the reason."""
        changes = {parameter.name: parameter.value for parameter in parameters}
        try:
            described = self._make_device(changes)
            for cylinder in self._cylinders:
                refusal = self._setpoint_refusal(self._setpoints[cylinder], described)
                if refusal is not None:
                    raise InputError(f'{convention.setpoint_topic(cylinder)} is {refusal}: set another set-point first')
        except InputError as error:
            return SetParametersResult(successful=False, reason=str(error))
        self._described_device = described
        self._apply_piston_parameters(changes)
        self._compare_range()
        self._defaults = [name for name in self._defaults if name not in changes]
        self._apply_changes(changes)
        return SetParametersResult(successful=True)

    def _apply_piston_parameters(self, changes: Mapping[str, Any]) -> None:
        """Set joint, stroke and reader of the piston from the parameters."""
        self._joint = self._value('joint', changes)
        self._stroke = self._value('stroke_lower', changes), self._value('stroke_upper', changes)
        self._piston = joint_reader(self, self._joint)

    def _compare_range(self) -> None:
        """Set the ranges with which the input is compared."""
        points = {name: cylinder.parameters.setpoints for name, cylinder in self._device.cylinders.items()}
        self._range.compare_with(
            self._described_device.identified_range,
            self._device.geometry.ambient_pressure,
            {name: (float(levels[0]), float(levels[-1])) for name, levels in points.items() if levels.size > 1},
        )

    def _listed_defaults(self) -> str:
        """List the gains and the area that are not given."""
        return ', '.join(self._defaults) or 'none'

    def _listed_not_identifiable(self) -> str:
        """List the gains that are not identifiable."""
        return ', '.join(self._described_device.not_identifiable) or 'none'

    @property
    def _supply(self) -> float:
        """Absolute supply pressure, the upper limit of all pressures [Pa]."""
        return self._described_device.number('supply_pressure') + self._device.geometry.ambient_pressure

    @property
    def _device(self) -> DeviceModel:
        """The simulated device."""
        return self._described_device.model

    def _apply_changes(self, changes: Mapping[str, Any]) -> None:
        """Apply changed parameters, and use `_device` from now on."""
        raise NotImplementedError

    def _lasting_warnings(self) -> list[str]:
        """Return the warnings that last until their cause ends."""
        warnings = [*self._on_parameter_file(), *self._on_piston_publishers()]
        for topic, (expected_type, qos) in self._subscribed.items():
            warnings += unheard_publishers(self, topic, expected_type, qos)
        warnings += [*self._on_stamps(), *self._refused_setpoints.values()]
        for name in self._cylinders:
            if name in self._without_setpoint:
                topic = convention.setpoint_topic(name)
                warnings.append(f'no {topic} yet: initial_setpoint {self._setpoints[name]:.0f} Pa acts')
        if not self._health.counts['samples'] and (where := other_topics(self, convention.PISTON_STATE)):
            warnings.append(where)
        warnings += self._range.report({name: self._setpoints[name] for name in self._cylinders})
        self._health.set_lasting_warnings(warnings)
        return warnings

    def _on_parameter_file(self) -> Iterator[str]:
        """Yield warnings on files for other nodes, and on cylinders without given gains."""
        yield from self._unread_files
        assumed = [name for name in self._cylinders if all(f'{name}.{gain}' in self._defaults for gain in NAMES)]
        if not assumed:
            return
        area, substitute = '', "the paper's Table 1 acts"
        if 'area' in self._defaults:
            area, substitute = ' and no area', "the paper's Table 1 and the default area act"
        if area and assumed == [*self._cylinders] and not has_files():
            yield f'no parameter file: {substitute}'
        else:
            yield f'no gains of {", ".join(assumed)}{area}: {substitute}'

    def _on_piston_publishers(self) -> Iterator[str]:
        """
        Yield a warning if several publishers send the piston joint.

        Discovery does not show which joints a publisher sends. So publishers are not counted before the first sample,
        nor if any of them sent messages without the joint.
        """
        publishers = publisher_names(self, convention.PISTON_STATE, JOINT_STATE)
        if self._health.increase(WITHOUT_JOINT):
            self._shared_publishers = publishers
        has_come = self._health.counts['samples'] or self._health.counts['ignored samples']
        if has_come and publishers != self._shared_publishers:
            yield from several_publishers(convention.PISTON_STATE, publishers)

    def _on_stamps(self) -> Iterator[str]:
        """Yield a warning if almost all samples since the last report repeat a stamp."""
        repeated, taken = self._health.increase(REPEATED), self._health.increase('samples')
        if repeated < _FEWEST_REPEATED or repeated < _REPEATED_PER_SAMPLE * taken:
            return
        remedy = 'stamp each sample with its time'
        if self._health.increase('zero stamps') and self._value('use_sim_time'):
            remedy = f'{remedy}, or let /clock run'
        yield (
            f'the stamps of {convention.PISTON_STATE} do not advance, {repeated} of {repeated + taken} samples repeat '
            f'a stamp: {remedy}'
        )

    def _publish_status(self, part: str, status: tuple[bytes, str], values: Mapping[str, str]) -> None:
        """Publish status and values of a part of the node on `/diagnostics`; the status is level and message."""
        self._diagnostics_out.publish(diagnostics(self, part, *status, values, self._value('hardware_id')))

    def _on_compiling(self, folder: str | None) -> None:
        cache = f'once: the cache is {folder}'
        if folder is None:
            cache = 'for this run only: no cache can be written. Name a folder for the cache in NUMBA_CACHE_DIR'
        self.get_logger().info(f'compiling the model, {cache}')
        self._publish_status('start', (DiagnosticStatus.WARN, 'not ready yet: compiling the model'), {})

    def _on_waiting(self) -> None:
        self.get_logger().info('another process compiles the model: waiting for it', once=True)
        self._publish_status('start', (DiagnosticStatus.WARN, 'not ready yet: another process compiles the model'), {})

    # topics

    def _listen_to_samples(self, message_type: type, topic: str, callback: Callable[[bytes], None]) -> None:
        """Subscribe to serialised samples; samples are dropped if they arrive faster than they are taken."""
        event_callbacks = self._event_callbacks(topic)
        qos = subscribe(
            self, message_type, topic, callback, SAMPLE_QOS, raw=True, backlog=self._samples, **event_callbacks
        )
        self._subscribed[topic] = type_name(message_type), qos

    def _listen_to_commands(self, topic: str, callback: Callable[[Float64], None]) -> None:
        """Subscribe to a number that holds until the next message."""
        qos = subscribe_latched(self, Float64, topic, callback, COMMAND_QOS, **self._event_callbacks(topic))
        self._subscribed[topic] = type_name(Float64), qos

    def _event_callbacks(self, topic: str) -> dict[str, Any]:
        """Return the callbacks that count lost and large messages and QoS mismatches."""
        return {
            'on_lost': partial(self._on_lost, topic),
            'on_mismatch': partial(self._on_mismatch, topic),
            'on_large': self._on_large,
        }

    def _listen_to_setpoints(self) -> None:
        for name in self._cylinders:
            self._listen_to_commands(convention.setpoint_topic(name), partial(self._on_setpoint, name))

    def _on_lost(self, topic: str, lost: int) -> None:
        self._health.counts[LOST] += lost
        self._health.warn(f'messages on {topic} are lost: they arrive faster than they are processed')

    def _on_large(self, message: str) -> None:
        self._health.counts[LARGE] += 1
        self._health.warn(message)

    def _on_mismatch(self, topic: str, publishers: int, policy: str) -> None:
        self._health.counts[MISMATCHED] += publishers
        self._health.warn(
            f'{topic} is published with another {policy} than requested, and not received: '
            "change the publisher's QoS or qos_overrides of this node"
        )

    def _on_setpoint(self, cylinder: str, message: Float64) -> None:
        topic, refusal = convention.setpoint_topic(cylinder), self._setpoint_refusal(message.data)
        if refusal is not None:
            self._ignore_setpoint(topic, f'{topic} {refusal}')
            return
        for accepted in (topic, convention.FORCE_SETPOINT):  # a force set-point sets this cylinder, too
            self._refused_setpoints.pop(accepted, None)
        self._setpoints[cylinder] = message.data
        self._without_setpoint.discard(cylinder)

    def _setpoint_refusal(self, setpoint: float, described: Device | None = None) -> str | None:
        """Return why a gauge set-point [Pa] is invalid for a device, by default the present device, or None."""
        device = described or self._described_device
        supply = device.number('supply_pressure')
        if not math.isfinite(setpoint):
            return f'{setpoint}, not a finite number'
        if setpoint < -device.number('ambient_pressure'):
            return f'{setpoint:.0f} Pa, below vacuum'
        if setpoint > supply:
            return f'{setpoint:.0f} Pa, above the supply pressure {supply:.0f} Pa'
        return None

    def _ignore_setpoint(self, topic: str, why: str) -> None:
        """Count a refused set-point, and warn until the topic has a valid set-point."""
        self._health.counts['ignored set-points'] += 1
        self._refused_setpoints[topic] = f'ignored: {why}; the set-point before acts'
        self._health.warn(self._refused_setpoints[topic])

    def _refused_position(self, position: float) -> str | None:
        """Return why a position of the piston [m] is refused, or None."""
        lower, upper = self._stroke
        if lower <= position <= upper:
            return None
        return f'is at {position:g} m, outside stroke_lower {lower:g} to stroke_upper {upper:g} m'

    def _on_piston(self, message: bytes) -> None:
        sample = self._piston.read(message)
        if sample is None and self._joint not in self._piston.names:  # several publishers may share the topic
            self._health.counts[WITHOUT_JOINT] += 1
            self._health.foreign_input = (
                f'no joint {self._joint!r}, but {_NAMES.repr(self._piston.names)}: check the parameter joint'
            )
            if self._health.silence > self._value('timeout'):
                self._health.warn(f'{convention.PISTON_STATE} has {self._health.foreign_input}')
            return
        if sample is not None and sample[0] is not None:  # a refused sample counts, too: a wrong unit may be the reason
            self._range.sample(sample[0] or self.get_clock().now().nanoseconds, sample[1])
        refusal = 'has no position' if sample is None else self._refused_position(sample[1])
        if sample is None or refusal is not None:
            self._health.counts['ignored samples'] += 1
            self._health.reject(f'joint {self._joint!r} in {convention.PISTON_STATE} {refusal}')
            return
        stamp = self._stamp(sample[0], convention.PISTON_STATE)
        if stamp is None:
            self._health.reject(invalid_stamp_text(convention.PISTON_STATE))
            return
        if self._commit(stamp, sample[1]):
            self._health.accept()
        else:
            self._health.counts['ignored samples'] += 1
            self._health.reject(
                f'joint {self._joint!r} in {convention.PISTON_STATE} at {sample[1]:g} m would give a pressure below '
                f'vacuum, or above the supply pressure {self._value("supply_pressure"):.0f} Pa'
            )

    def _stamp(self, stamp: int | None, topic: str) -> int | None:
        """
        Return a message's stamp [ns], or the time of receipt if the stamp is zero, as from `ros2 topic pub`.

        Return None and count the message if the stamp is invalid.
        """
        if stamp is None:
            self._health.counts['ignored stamps'] += 1
            return None
        if stamp != 0:
            return stamp
        if not self._health.counts['zero stamps']:
            self.get_logger().warning(f'{topic} has a zero stamp: the time of receipt is used instead')
        self._health.counts['zero stamps'] += 1
        return self.get_clock().now().nanoseconds

    def _note_sample(self, pressures: Iterable[float]) -> None:
        """Count a sample, and note the model's pressures at the sample [Pa]."""
        self._health.counts['samples'] += 1
        self._range.predicted(self._cylinders, pressures)

    def _commit(self, stamp: int, position: float) -> bool:
        """Advance the model to a stamp [ns] and displacement [m]; return False if a pressure would be impossible."""
        raise NotImplementedError

    def _absolute_setpoints(self) -> tuple[float, float]:
        ambient = self._device.geometry.ambient_pressure
        return self._setpoints['cylinder_a'] + ambient, self._setpoints['cylinder_b'] + ambient


def invalid_stamp_text(topic: str) -> str:
    """Return the message on a topic with an invalid stamp."""
    return f'{topic} has an invalid stamp: sec is negative, or nanosec is a second or more'
