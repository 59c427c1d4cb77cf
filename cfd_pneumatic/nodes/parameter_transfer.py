# SPDX-License-Identifier: Apache-2.0
"""Transfer of parameters to another node."""

from __future__ import annotations

import time
from collections.abc import Generator, Mapping
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from rcl_interfaces.srv import GetParameters, SetParametersAtomically
from rclpy.node import Node
from rclpy.parameter import Parameter, parameter_value_to_python
from rclpy.task import Future

from cfd_pneumatic import convention
from cfd_pneumatic.device import DESCRIPTORS, Value

SERVICES = {GetParameters: 'get_parameters', SetParametersAtomically: 'set_parameters_atomically'}
"""The services of the target, and their names."""

_RETRY_PERIOD = 1.0  # a request without a reply is repeated after this time [s]
_SERVICE_WAIT = 5.0  # longest time until a target appears or answers [s]


class ParameterTransfer:
    """
    Sets parameters on another node atomically.

    The target keeps its cylinders and initial set-points, which nodes read at their start only. The outcome reports
    cylinders that differ.

    Attributes
    ----------
    earlier
        Parameters of the target before the transfer; empty until the transfer has succeeded.

    """

    def __init__(self, node: Node, target: str, wanted: Mapping[str, Value], remedy: str = '') -> None:
        """Begin the transfer of parameters by name; `remedy` is the text if cylinders differ."""
        self.target = target.rstrip('/')
        self.earlier: dict[str, Value] = {}
        self._node = node
        self._remedy = remedy
        self._values = {name: value for name, value in wanted.items() if not DESCRIPTORS[name].at_start}
        self._present = {
            f'{cylinder}.enabled': wanted.get(f'{cylinder}.enabled', True) for cylinder in convention.CYLINDERS
        }
        self._clients = {
            service.Request: node.create_client(service, f'{self.target}/{name}') for service, name in SERVICES.items()
        }
        self._deadline = time.monotonic() + _SERVICE_WAIT
        self._requests = self._exchange()
        self._request = next(self._requests)
        self._reply: Future | None = None
        self._sent_at = 0.0

    def advance(self) -> tuple[bytes, str] | None:
        """Advance the transfer; return level and message when the transfer has ended."""
        if self._reply is None:
            if all(client.service_is_ready() for client in self._clients.values()):
                self._send_request()
        elif self._reply.done():
            try:
                self._request = self._requests.send(self._reply.result())
            except StopIteration as ended:
                outcome: tuple[bytes, str] = ended.value
                return outcome
            self._send_request()
        elif time.monotonic() - self._sent_at > _RETRY_PERIOD:
            self._send_request()  # a reply is lost if the target has not discovered this client yet
        if time.monotonic() > self._deadline:
            return DiagnosticStatus.ERROR, f'{self.target} (parameter apply_to) does not answer: check its name'
        return None

    def _send_request(self) -> None:
        self._sent_at = time.monotonic()
        self._reply = self._clients[type(self._request)].call_async(self._request)

    def _exchange(self) -> Generator[Any, Any, tuple[bytes, str]]:
        """Yield requests, receive their replies, and return level and message."""
        names = [*self._values, *self._present]
        present_values = (yield GetParameters.Request(names=names)).values
        earlier = {name: parameter_value_to_python(value) for name, value in zip(names, present_values)}
        if len(earlier) < len(names) or None in earlier.values():
            return DiagnosticStatus.ERROR, f'{self.target} (parameter apply_to) is no sim_node: name a sim_node'
        present = {name: earlier.pop(name) for name in self._present}
        differ = [f'{name} is {str(on).lower()} there' for name, on in present.items() if on != self._present[name]]
        values = {name: list(value) if isinstance(value, tuple) else value for name, value in self._values.items()}
        parameters = [Parameter(name, value=value).to_parameter_msg() for name, value in values.items()]
        result = (yield SetParametersAtomically.Request(parameters=parameters)).result
        if not result.successful:
            return DiagnosticStatus.ERROR, f'{self.target} refused the parameters: {result.reason}'
        self.earlier = {**earlier, **present}
        done = f'parameters set on {self.target}'
        if differ:
            return DiagnosticStatus.WARN, f'{done}, but {" and ".join(differ)}{self._remedy}'
        return DiagnosticStatus.OK, done

    def close(self) -> None:
        """Destroy the clients."""
        for client in self._clients.values():
            self._node.destroy_client(client)
