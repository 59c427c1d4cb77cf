# SPDX-License-Identifier: Apache-2.0
"""The base of every node: whatever a stranger in the graph sends, the node's memory stays bounded."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

from rcl_interfaces.msg import SetParametersResult
from rcl_interfaces.srv import SetParameters
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile
from rclpy.service import Service

from cfd_pneumatic.nodes.parameters import as_declared, wrong_type

_SERVICE_QOS = QoSProfile(depth=10)
"""rclpy queues 1,000 requests for parameters, and the middleware keeps the memory of the largest ones."""

_Callback = Callable[[Any, Any], Any]

_ASKED_FOR = ('parameters', 'names', 'prefixes')
"""Fields of the requests to rclpy's services for parameters."""

_MOST_NAMES = 500  # of parameters in a request, twice those of a device
_LONGEST_NAME = 256  # characters of a parameter's name
_LARGEST_REQUEST = 32 * 1024
"""Size of the parameters that are set at once [bytes], four times those of a device; each change is published, too."""


class BoundedNode(Node):
    """
    A node with short queues for requests, and with limits on the size of its parameters.

    Topics are bounded by `listen_to`.
    """

    def create_service(self, srv_type: type, srv_name: str, callback: _Callback, **kwargs: Any) -> Service:
        """Offer a service as every node does, with a short queue; requests about too many parameters are refused."""
        options = {**kwargs, 'qos_profile': _SERVICE_QOS}
        answer = partial(self._set_together, callback) if srv_type is SetParameters else callback
        return super().create_service(srv_type, srv_name, partial(_answer, answer), **options)

    def _set_together(self, callback: _Callback, request: SetParameters.Request, response: Any) -> Any:
        """
        Set the parameters of a request at once if they are accepted together, and one by one if not.

        What `ros2 param dump` writes must be set at once: set-points and gains may have other lengths than before.
        Parameters that are read-only or not declared are refused alone, unless they have their value already.
        """
        asked = as_declared(self, [Parameter.from_parameter_msg(parameter) for parameter in request.parameters])
        accepted: set[str] = set()
        if len(asked) > 1:
            accepted = {parameter.name for parameter in asked if self._holds(parameter)}
            together = [
                parameter for parameter in asked if parameter.name not in accepted and self._is_settable(parameter.name)
            ]
            if together and self.set_parameters_atomically(together).successful:
                accepted |= {parameter.name for parameter in together}
        alone = [parameter.to_parameter_msg() for parameter in asked if parameter.name not in accepted]
        results = iter(callback(SetParameters.Request(parameters=alone), SetParameters.Response()).results)
        response.results = [
            SetParametersResult(successful=True) if parameter.name in accepted else next(results) for parameter in asked
        ]
        return response

    def _is_settable(self, name: str) -> bool:
        """Return whether a parameter is declared and may be set while the node runs."""
        return self.has_parameter(name) and not self.describe_parameter(name).read_only

    def _holds(self, parameter: Parameter) -> bool:
        """Return whether a parameter has this value."""
        return self.has_parameter(parameter.name) and self.get_parameter(parameter.name).value == parameter.value

    def set_parameters_atomically(self, parameter_list: list[Parameter]) -> SetParametersResult:
        """Set parameters as every node does; refuse those without a name, too large, or of another type."""
        parameter_list = as_declared(self, parameter_list)
        refusal = _unfit(parameter_list) or wrong_type(self, parameter_list)
        if refusal is not None:
            return SetParametersResult(successful=False, reason=refusal)
        return super().set_parameters_atomically(parameter_list)


def _answer(callback: _Callback, request: Any, response: Any) -> Any:
    """Answer a request, unless it asks for parameters again and again: rclpy goes through them one by one."""
    asked = next((getattr(request, field) for field in _ASKED_FOR if hasattr(request, field)), ())
    names = [getattr(one, 'name', one) for one in asked[: _MOST_NAMES + 1]]
    if len(asked) <= _MOST_NAMES and len(set(names)) == len(asked):
        return callback(request, response)
    refused = SetParametersResult(reason=f'a request must name each parameter once, and at most {_MOST_NAMES}')
    if hasattr(response, 'results'):
        response.results = [refused] * len(asked)
    elif isinstance(getattr(response, 'result', None), SetParametersResult):
        response.result = refused
    return response


def _unfit(parameters: Sequence[Parameter]) -> str | None:
    """Return why parameters are not looked at, or None."""
    if not all(0 < len(parameter.name) <= _LONGEST_NAME for parameter in parameters):
        return f'the name of a parameter must have 1 to {_LONGEST_NAME} characters'
    size = sum(len(parameter.name) + _size(parameter.value) for parameter in parameters)
    if size > _LARGEST_REQUEST:
        return f'the parameters have {size:,} bytes, and must have at most {_LARGEST_REQUEST:,} together'
    return None


def _size(value: Any) -> int:
    """Return about how many bytes a parameter's value has in a message."""
    if isinstance(value, str):
        return len(value.encode(errors='replace'))
    if isinstance(value, (bytes, bytearray)):
        return len(value)
    if isinstance(value, Sequence) or hasattr(value, '__len__'):
        return sum(map(_size, value))
    return 8
