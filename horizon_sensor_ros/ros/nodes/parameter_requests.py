"""Requests to set a node's parameters, with values that are of no type."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

from rcl_interfaces.msg import Parameter, SetParametersResult
from rcl_interfaces.srv import SetParameters, SetParametersAtomically
from rclpy.node import Node
from rclpy.parameter import Parameter as RosParameter

_TYPES = {each.value for each in RosParameter.Type}

# A service's callback: request and response to response.
_Answer = Callable[[Any, Any], Any]


def refuse_values_of_no_type(node: Node) -> None:
    """Let a node answer requests to set parameters as rclpy does, but refuse values of an unknown
    type: rclpy raises its error, a ValueError, and so ends the process.
    """
    for service in node.services:
        if service.srv_type is SetParameters:
            service.callback = partial(_set_each, service.callback)
        elif service.srv_type is SetParametersAtomically:
            service.callback = partial(_set_all, service.callback)


def _set_each(
    answer: _Answer, request: SetParameters.Request, response: SetParameters.Response
) -> SetParameters.Response:
    refusals = [_refusal([each]) for each in request.parameters]
    known = [p for p, no in zip(request.parameters, refusals, strict=True) if no is None]
    results = iter(answer(SetParameters.Request(parameters=known), response).results)
    response.results = [next(results) if no is None else no for no in refusals]
    return response


def _set_all(
    answer: _Answer,
    request: SetParametersAtomically.Request,
    response: SetParametersAtomically.Response,
) -> SetParametersAtomically.Response:
    refusal = _refusal(request.parameters)
    if refusal is None:
        return answer(request, response)
    response.result = refusal
    return response


def _refusal(parameters: list[Parameter]) -> SetParametersResult | None:
    """Why these are not set; None where each has a value of a type that there is."""
    for each in parameters:
        if each.value.type not in _TYPES:
            reason = f"{each.name}: there is no type {each.value.type} of parameters"
            return SetParametersResult(successful=False, reason=reason)
    return None
