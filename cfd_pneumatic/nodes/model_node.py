# SPDX-License-Identifier: Apache-2.0
"""What nodes share that run the device's model: its parameters, its set-points, the piston's samples."""

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
from cfd_pneumatic.nodes.topics import Queue, listen_to, listen_to_held
from cfd_pneumatic.runtime import announced

_FARTHEST = 1e3  # what a stroke may end at [m]; a number beyond would take the model out of floating point's range
_STROKE = 1.0  # no end effector's piston is farther from where it is counted from [m]
_FEWEST_REPEATED = 3  # samples that repeat a stamp before there is a warning
_REPEATED_PER_SAMPLE = 20  # that many to each that does not: a driver at 1 kHz may repeat each sample of a sensor
_NAMES = reprlib.Repr()  # of the joints in a message, which may be any number of any length
_NAMES.maxlist, _NAMES.maxstring = 20, 80


class ModelNode(BoundedNode):
    """
    A node that runs the device's model; every parameter is described, with its unit, in its descriptor.

    Who derives from it says what to do with a sample (`_commit`) and with a model that has changed (`_adopt`).
    """

    def __init__(self, name: str, **kwargs: Any) -> None:
        """Declare parameters and compile the model."""
        super().__init__(name, **kwargs)
        self._health = InputHealth(self, convention.PISTON_STATE)
        self._samples = Queue()
        self._subscribed: dict[str, tuple[str, QoSProfile]] = {}  # the type and the QoS of each topic
        self._sharing: list[str] = []  # publishers of piston_state among which others than the piston's are
        self._diagnostics_out = self.create_publisher(DiagnosticArray, convention.DIAGNOSTICS, OUTPUT_QOS)
        axis = self._parameter_overrides.get('axis')
        if axis is not None and axis.value is True:  # YAML takes a bare y for true, and `ros2 param dump` writes it so
            self._parameter_overrides['axis'] = Parameter('axis', value='y')
        self._declare_parameters()
        self._described = self._make_device({})
        self._cylinders = tuple(self._device.cylinders)
        self._refused_setpoints: dict[str, str] = {}  # the warning, by topic
        wanted = ['area', *(f'{cylinder}.{gain}' for cylinder in self._cylinders for gain in NAMES)]
        self._defaults = [name for name in wanted if name not in self._parameter_overrides]
        self._setpoints = {name: self._value(f'{name}.initial_setpoint') for name in convention.CYLINDERS}
        self._waiting = set(self._cylinders)  # for a first set-point
        self._range = InputRange(self._described.identified_range)
        self._compare_range()
        for cylinder in self._cylinders:
            refusal = self._refusal(self._setpoints[cylinder])
            if refusal is not None:
                raise InputError(f'{cylinder}.initial_setpoint is {refusal}')
        self._adopt_piston({})
        self._unread = list(unread_files(self))
        instead = "the paper's Table 1 and the default area stand in for them"
        if self._defaults == wanted:
            self.get_logger().info(f'no gains and no area are given: {instead}')
        elif self._defaults:
            self.get_logger().warning(f'not given: {self._told_defaults()}; {instead}')
        if self._described.not_identifiable:
            self.get_logger().warning(f'no recording told {self._told_doubtful()}: as the fit used it')
        with announced(self._on_compiling, self._on_waiting):
            self._warm_up()

    def _warm_up(self) -> None:
        """Compile what a sample takes."""
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
                "x, 'y' (in quotes: YAML takes a bare y for true) or z",
            ),
        )
        declare('stroke_lower', -_STROKE, number('m', -_FARTHEST, _FARTHEST, 'a displacement below is refused'))
        declare('stroke_upper', _STROKE, number('m', -_FARTHEST, _FARTHEST, 'a displacement above is refused'))
        declare('hardware_id', '', text('serial number of the device, for /diagnostics; empty: the name of the node'))
        declare('max_gap', 1.0, number('s', 1e-3, 1e3, 'a longer step between samples starts the model anew'))
        declare('timeout', 0.5, number('s', 1e-2, 1e3, 'silence of piston_state that /diagnostics calls an error'))
        declare_device(self)

    def _make_device(self, changes: Mapping[str, Any]) -> Device:
        if self._value('axis', changes) not in AXES:
            raise InputError(f'axis {self._value("axis", changes)!r} is not one of {", ".join(AXES)}')
        checked_frame(self._value('frame_id', changes))
        lower, upper = (self._value(f'stroke_{end}', changes) for end in ('lower', 'upper'))
        if not lower < upper:
            raise InputError(f'stroke_lower {lower:g} m does not lie below stroke_upper {upper:g} m')
        return device_of(self, changes)

    def _on_parameters(self, parameters: list[Parameter]) -> SetParametersResult:
        """Take good values from the next sample on; reject others with the reason."""
        changes = {parameter.name: parameter.value for parameter in parameters}
        try:
            described = self._make_device(changes)
            for cylinder in self._cylinders:
                refusal = self._refusal(self._setpoints[cylinder], described)
                if refusal is not None:
                    raise InputError(f'{convention.setpoint_topic(cylinder)} is {refusal}: set another set-point first')
        except InputError as error:
            return SetParametersResult(successful=False, reason=str(error))
        self._described = described
        self._adopt_piston(changes)
        self._compare_range()
        self._defaults = [name for name in self._defaults if name not in changes]
        self._adopt(changes)
        return SetParametersResult(successful=True)

    def _adopt_piston(self, changes: Mapping[str, Any]) -> None:
        """Read the piston as the parameters say from now on."""
        self._joint = self._value('joint', changes)
        self._stroke = self._value('stroke_lower', changes), self._value('stroke_upper', changes)
        self._piston = joint_reader(self, self._joint)

    def _compare_range(self) -> None:
        """Compare input with the range of the device as the parameters describe it."""
        points = {name: cylinder.parameters.setpoints for name, cylinder in self._device.cylinders.items()}
        self._range.compare_with(
            self._described.identified_range,
            self._device.geometry.ambient_pressure,
            {name: (float(levels[0]), float(levels[-1])) for name, levels in points.items() if levels.size > 1},
        )

    def _told_defaults(self) -> str:
        """Return which of the gains and the area nobody gave."""
        return ', '.join(self._defaults) or 'none'

    def _told_doubtful(self) -> str:
        """Return which of the gains no recording told."""
        return ', '.join(self._described.not_identifiable) or 'none'

    @property
    def _supply(self) -> float:
        """Absolute pressure that none can exceed [Pa]."""
        return self._described.number('supply_pressure') + self._device.geometry.ambient_pressure

    @property
    def _device(self) -> DeviceModel:
        """What is simulated."""
        return self._described.model

    def _adopt(self, changes: Mapping[str, Any]) -> None:
        """Use `_device` from now on, and what else has changed."""
        raise NotImplementedError

    def _standing(self) -> list[str]:
        """Return in words what is not as it should be, and lasts."""
        words = [*self._on_parameter_file(), *self._on_piston_publishers()]
        for topic, (expected_type, qos) in self._subscribed.items():
            words += unheard_publishers(self, topic, expected_type, qos)
        words += [*self._on_stamps(), *self._refused_setpoints.values()]
        for name in self._cylinders:
            if name in self._waiting:
                topic = convention.setpoint_topic(name)
                words.append(f'no {topic} yet: initial_setpoint {self._setpoints[name]:.0f} Pa acts')
        if not self._health.counts['samples'] and (where := other_topics(self, convention.PISTON_STATE)):
            words.append(where)
        words += self._range.report({name: self._setpoints[name] for name in self._cylinders})
        self._health.standing(words)
        return words

    def _on_parameter_file(self) -> Iterator[str]:
        """Yield warnings on files for other nodes, and on cylinders whose gains nobody gave."""
        yield from self._unread
        assumed = [name for name in self._cylinders if all(f'{name}.{gain}' in self._defaults for gain in NAMES)]
        if not assumed:
            return
        area, acting = '', "the paper's Table 1 acts"
        if 'area' in self._defaults:
            area, acting = ' and no area', "the paper's Table 1 and the default area act"
        if area and assumed == [*self._cylinders] and not has_files():
            yield f'no parameter file: {acting}'
        else:
            yield f'no gains of {", ".join(assumed)}{area}: {acting}'

    def _on_piston_publishers(self) -> Iterator[str]:
        """
        Yield a warning if several publishers send the piston joint.

        Discovery does not show which joints a publisher sends. So publishers are not counted before the first sample,
        nor if messages without the joint came from among them.
        """
        publishers = publisher_names(self, convention.PISTON_STATE, JOINT_STATE)
        if self._health.grown(WITHOUT_JOINT):
            self._sharing = publishers
        has_come = self._health.counts['samples'] or self._health.counts['ignored samples']
        if has_come and publishers != self._sharing:
            yield from several_publishers(convention.PISTON_STATE, publishers)

    def _on_stamps(self) -> Iterator[str]:
        """Yield a warning if almost all samples since the last report repeat a stamp."""
        repeated, taken = self._health.grown(REPEATED), self._health.grown('samples')
        if repeated < _FEWEST_REPEATED or repeated < _REPEATED_PER_SAMPLE * taken:
            return
        remedy = 'stamp each sample with its time'
        if self._health.grown('zero stamps') and self._value('use_sim_time'):
            remedy = f'{remedy}, or let /clock run'
        yield (
            f'the stamps of {convention.PISTON_STATE} do not advance, {repeated} of {repeated + taken} samples repeat '
            f'a stamp: {remedy}'
        )

    def _say(self, part: str, verdict: tuple[bytes, str], values: Mapping[str, str]) -> None:
        """Publish on `/diagnostics` how a part of the node does: level and words, and values beside them."""
        self._diagnostics_out.publish(diagnostics(self, part, *verdict, values, self._value('hardware_id')))

    def _on_compiling(self, folder: str | None) -> None:
        kept = f'once: it is kept in {folder}'
        if folder is None:
            kept = 'for this run only: no cache can be written, name a folder for it in NUMBA_CACHE_DIR'
        self.get_logger().info(f'compiling the model, {kept}')
        self._say('start', (DiagnosticStatus.WARN, 'not ready yet: compiling the model'), {})

    def _on_waiting(self) -> None:
        self.get_logger().info('another process compiles the model: waiting for it', once=True)
        self._say('start', (DiagnosticStatus.WARN, 'not ready yet: another process compiles the model'), {})

    # topics

    def _listen_to_samples(self, message_type: type, topic: str, callback: Callable[[bytes], None]) -> None:
        """Subscribe to what is measured, serialised; in need some is shed."""
        counted = self._counted(topic)
        qos = listen_to(self, message_type, topic, callback, SAMPLE_QOS, raw=True, queue=self._samples, **counted)
        self._subscribed[topic] = type_name(message_type), qos

    def _listen_to_commands(self, topic: str, callback: Callable[[Float64], None]) -> None:
        """Subscribe to a number that holds until the next."""
        qos = listen_to_held(self, Float64, topic, callback, COMMAND_QOS, **self._counted(topic))
        self._subscribed[topic] = type_name(Float64), qos

    def _counted(self, topic: str) -> dict[str, Any]:
        """Return what counts messages that are lost or large, and who offers too little."""
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
        self._health.warn(f'messages on {topic} are lost: they come faster than they are taken')

    def _on_large(self, what: str) -> None:
        self._health.counts[LARGE] += 1
        self._health.warn(what)

    def _on_mismatch(self, topic: str, publishers: int, policy: str) -> None:
        self._health.counts[MISMATCHED] += publishers
        self._health.warn(
            f'{topic} is published with another {policy} than is asked for, and so not heard: '
            "set the publisher's, or qos_overrides here"
        )

    def _on_setpoint(self, cylinder: str, message: Float64) -> None:
        topic, refusal = convention.setpoint_topic(cylinder), self._refusal(message.data)
        if refusal is not None:
            self._ignore_setpoint(topic, f'{topic} {refusal}')
            return
        for accepted in (topic, convention.FORCE_SETPOINT):  # the force would set this cylinder, too
            self._refused_setpoints.pop(accepted, None)
        self._setpoints[cylinder] = message.data
        self._waiting.discard(cylinder)

    def _refusal(self, setpoint: float, described: Device | None = None) -> str | None:
        """Return why a gauge set-point [Pa] cannot act, by default on the present device; None if it can."""
        device = described or self._described
        supply = device.number('supply_pressure')
        if not math.isfinite(setpoint):
            return f'{setpoint}, not a finite number'
        if setpoint < -device.number('ambient_pressure'):
            return f'{setpoint:.0f} Pa, below vacuum'
        if setpoint > supply:
            return f'{setpoint:.0f} Pa, above the supply pressure {supply:.0f} Pa'
        return None

    def _ignore_setpoint(self, topic: str, why: str) -> None:
        """Count a refused set-point, and warn until the topic has another one."""
        self._health.counts['ignored set-points'] += 1
        self._refused_setpoints[topic] = f'ignored: {why}; the set-point before acts'
        self._health.warn(self._refused_setpoints[topic])

    def _refused_position(self, position: float) -> str | None:
        """Return why the piston cannot be at a position [m], or None."""
        lower, upper = self._stroke
        if lower <= position <= upper:
            return None
        return f'is at {position:g} m, outside stroke_lower {lower:g} to stroke_upper {upper:g} m'

    def _on_piston(self, message: bytes) -> None:
        told = self._piston.read(message)
        if told is None and self._joint not in self._piston.names:  # several publishers may share the topic
            self._health.counts[WITHOUT_JOINT] += 1
            self._health.meanwhile = f'no joint {self._joint!r}, but {_NAMES.repr(self._piston.names)}'
            if self._health.silence > self._value('timeout'):
                self._health.warn(f'{convention.PISTON_STATE} has {self._health.meanwhile}')
            return
        if told is not None and told[0] is not None:  # also if it is refused: its unit may be the reason
            self._range.sample(told[0] or self.get_clock().now().nanoseconds, told[1])
        refusal = 'has no position' if told is None else self._refused_position(told[1])
        if told is None or refusal is not None:
            self._health.counts['ignored samples'] += 1
            self._health.bad(f'joint {self._joint!r} in {convention.PISTON_STATE} {refusal}')
            return
        stamp = self._stamp(told[0], convention.PISTON_STATE)
        if stamp is None:
            self._health.bad(no_time(convention.PISTON_STATE))
            return
        if self._commit(stamp, told[1]):
            self._health.good()
        else:
            self._health.counts['ignored samples'] += 1
            self._health.bad(
                f'joint {self._joint!r} in {convention.PISTON_STATE} at {told[1]:g} m would give a pressure below '
                f'vacuum, or above the supply pressure {self._value("supply_pressure"):.0f} Pa'
            )

    def _stamp(self, stamp: int | None, topic: str) -> int | None:
        """
        Return a message's stamp [ns]; the time of receipt where it has none, as from a bare `ros2 topic pub`.

        None where it is no time, which is counted.
        """
        if stamp is None:
            self._health.counts['ignored stamps'] += 1
            return None
        if stamp != 0:
            return stamp
        if not self._health.counts['zero stamps']:
            self.get_logger().warning(f'{topic} has a zero stamp: the time of receipt is taken instead')
        self._health.counts['zero stamps'] += 1
        return self.get_clock().now().nanoseconds

    def _note_sample(self, pressures: Iterable[float]) -> None:
        """Note a sample that was taken, and the model's pressures at it [Pa]."""
        self._health.counts['samples'] += 1
        self._range.predicted(self._cylinders, pressures)

    def _commit(self, stamp: int, position: float) -> bool:
        """Take a sample of the piston, its stamp [ns] and its displacement [m], if that gives possible pressures."""
        raise NotImplementedError

    def _absolute_setpoints(self) -> tuple[float, float]:
        ambient = self._device.geometry.ambient_pressure
        return self._setpoints['cylinder_a'] + ambient, self._setpoints['cylinder_b'] + ambient


def no_time(topic: str) -> str:
    """Return what is wrong with a topic whose stamp is ignored."""
    return f'{topic} has a stamp that is no time: sec is negative, or nanosec a second or more'
