# SPDX-License-Identifier: Apache-2.0
"""Setting the parameters of another node."""

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

_ASK_AGAIN = 1.0  # a request to set or get parameters is repeated after this time [s]
_SERVICE_WAIT = 5.0  # how long a target may take to appear or answer [s]


class ParameterTransfer:
    """
    Setting parameters on another node, all at once or not at all.

    A target that has a cylinder more or less than is wanted keeps it, which is said: nodes take that at their start
    alone, as they do initial set-points.

    Attributes
    ----------
    earlier
        What the target had before, once it was set.

    """

    def __init__(self, node: Node, target: str, wanted: Mapping[str, Value], remedy: str = '') -> None:
        """Begin with parameters by their names, and a remedy where cylinders differ; `proceed` goes on."""
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
        self._dialogue = self._talk()
        self._request = next(self._dialogue)
        self._reply: Future | None = None
        self._asked = 0.0

    def proceed(self) -> tuple[bytes, str] | None:
        """Go on as far as possible; return level and message when it has ended."""
        if self._reply is None:
            if all(client.service_is_ready() for client in self._clients.values()):
                self._ask()
        elif self._reply.done():
            try:
                self._request = self._dialogue.send(self._reply.result())
            except StopIteration as ended:
                outcome: tuple[bytes, str] = ended.value
                return outcome
            self._ask()
        elif time.monotonic() - self._asked > _ASK_AGAIN:
            self._ask()  # a reply is lost if it leaves before its sender has discovered this client
        if time.monotonic() > self._deadline:
            return DiagnosticStatus.ERROR, f'{self.target} (parameter apply_to) is not there: check its name'
        return None

    def _ask(self) -> None:
        self._asked = time.monotonic()
        self._reply = self._clients[type(self._request)].call_async(self._request)

    def _talk(self) -> Generator[Any, Any, tuple[bytes, str]]:
        """Yield requests, get their replies, and return level and message."""
        names = [*self._values, *self._present]
        held = (yield GetParameters.Request(names=names)).values
        earlier = {name: parameter_value_to_python(value) for name, value in zip(names, held)}
        if len(earlier) < len(names) or None in earlier.values():
            return DiagnosticStatus.ERROR, f'{self.target} (parameter apply_to) is no sim_node'
        present = {name: earlier.pop(name) for name in self._present}
        differ = [f'{name} is {str(on).lower()} there' for name, on in present.items() if on != self._present[name]]
        values = {name: list(one) if isinstance(one, tuple) else one for name, one in self._values.items()}
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
        """Give the clients back."""
        for client in self._clients.values():
            self._node.destroy_client(client)
