# SPDX-License-Identifier: Apache-2.0
"""The base of every node: the node's memory stays bounded, whichever messages and requests arrive."""

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

from cfd_pneumatic.nodes.parameters import convert_numbers, wrong_type

_SERVICE_QOS = QoSProfile(depth=10)
"""Short queue: rclpy queues 1,000 parameter requests, and the middleware keeps the memory of the largest requests."""

_Callback = Callable[[Any, Any], Any]

_REQUEST_FIELDS = ('parameters', 'names', 'prefixes')
"""Fields of the requests to rclpy's services for parameters."""

_MOST_NAMES = 500  # parameters in a request, twice those of a device
_LONGEST_NAME = 256  # characters of a parameter's name
_LARGEST_REQUEST = 32 * 1024
"""Largest size of parameters that are set at once [bytes], four times those of a device: each change is published."""


class BoundedNode(Node):
    """
    A node with short queues for requests, and with limits on the size of its parameters.

    Topics are bounded by `subscribe`.
    """

    def create_service(self, srv_type: type, srv_name: str, callback: _Callback, **kwargs: Any) -> Service:
        """Create a service with a short queue that refuses requests about too many parameters."""
        options = {**kwargs, 'qos_profile': _SERVICE_QOS}
        answer = partial(self._set_requested_parameters, callback) if srv_type is SetParameters else callback
        return super().create_service(srv_type, srv_name, partial(_answer_request, answer), **options)

    def _set_requested_parameters(self, callback: _Callback, request: SetParameters.Request, response: Any) -> Any:
        """
        Set the parameters of a request atomically if possible, otherwise individually.

        A file of `ros2 param dump` must be set atomically: set-points and gains may have new lengths. Read-only and
        undeclared parameters are refused individually, unless a parameter already has the value.
        """
        requested = convert_numbers(self, [Parameter.from_parameter_msg(parameter) for parameter in request.parameters])
        accepted: set[str] = set()
        if len(requested) > 1:
            accepted = {parameter.name for parameter in requested if self._has_value(parameter)}
            together = [
                parameter
                for parameter in requested
                if parameter.name not in accepted and self._is_settable(parameter.name)
            ]
            if together and self.set_parameters_atomically(together).successful:
                accepted |= {parameter.name for parameter in together}
        remaining = [parameter.to_parameter_msg() for parameter in requested if parameter.name not in accepted]
        results = iter(callback(SetParameters.Request(parameters=remaining), SetParameters.Response()).results)
        response.results = [
            SetParametersResult(successful=True) if parameter.name in accepted else next(results)
            for parameter in requested
        ]
        return response

    def _is_settable(self, name: str) -> bool:
        """Return whether a parameter is declared and may be set while the node runs."""
        return self.has_parameter(name) and not self.describe_parameter(name).read_only

    def _has_value(self, parameter: Parameter) -> bool:
        """Return whether a parameter already has the value."""
        return self.has_parameter(parameter.name) and self.get_parameter(parameter.name).value == parameter.value

    def set_parameters_atomically(self, parameter_list: list[Parameter]) -> SetParametersResult:
        """Set parameters atomically; refuse parameters without a name, of another type, or that are too large."""
        parameter_list = convert_numbers(self, parameter_list)
        refusal = _size_refusal(parameter_list) or wrong_type(self, parameter_list)
        if refusal is not None:
            return SetParametersResult(successful=False, reason=refusal)
        return super().set_parameters_atomically(parameter_list)


def _answer_request(callback: _Callback, request: Any, response: Any) -> Any:
    """Answer a request; refuse repeated or too many parameters, which rclpy would process individually."""
    requested = next((getattr(request, field) for field in _REQUEST_FIELDS if hasattr(request, field)), ())
    names = [getattr(item, 'name', item) for item in requested[: _MOST_NAMES + 1]]
    if len(requested) <= _MOST_NAMES and len(set(names)) == len(requested):
        return callback(request, response)
    refused = SetParametersResult(
        reason=f'a request must name each parameter once, and at most {_MOST_NAMES} parameters'
    )
    if hasattr(response, 'results'):
        response.results = [refused] * len(requested)
    elif isinstance(getattr(response, 'result', None), SetParametersResult):
        response.result = refused
    return response


def _size_refusal(parameters: Sequence[Parameter]) -> str | None:
    """Return why parameters are refused before they are checked, or None."""
    if not all(0 < len(parameter.name) <= _LONGEST_NAME for parameter in parameters):
        return f'the name of a parameter must have 1 to {_LONGEST_NAME} characters'
    size = sum(len(parameter.name) + _size(parameter.value) for parameter in parameters)
    if size > _LARGEST_REQUEST:
        return f'the parameters have {size:,} bytes together, the limit is {_LARGEST_REQUEST:,}'
    return None


def _size(value: Any) -> int:
    """Estimate the size of a parameter's value in a message [bytes]."""
    if isinstance(value, str):
        return len(value.encode(errors='replace'))
    if isinstance(value, (bytes, bytearray)):
        return len(value)
    if isinstance(value, Sequence) or hasattr(value, '__len__'):
        return sum(map(_size, value))
    return 8
