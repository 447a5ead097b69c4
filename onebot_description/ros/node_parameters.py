"""Declares the parameters of a checked dataclass on a node, and follows their changes."""

import contextlib
import sys
from collections.abc import Callable
from typing import Any

from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    SetParametersResult,
)
from rclpy.exceptions import InvalidParameterValueException, ParameterNotDeclaredException
from rclpy.node import Node
from rclpy.parameter import Parameter

from onebot_description.errors import OneBotError
from onebot_description.parameters.reader import (
    Values,
    defaults,
    is_parameter,
    ros_value,
    unknown_parameters,
    value_type,
)
from onebot_description.parameters.values import plain


def declare(
    node: Node, kind: type, values: Values | None = None, fixed: Values | None = None
) -> dict[str, Any]:
    """Declare every parameter of a dataclass on a node.

    Types are left open, so that ``read`` reports wrong types with all other problems; an integer
    for a double is declared as a double.

    Args:
        node: the node.
        kind: the dataclass.
        values: values that replace the defaults, and names that the user chooses; None for a
            parameter that the command line sets.
        fixed: values that override the command line.

    Returns:
        The resulting values, by dotted name.
    """
    first = {**defaults(kind), **(values or {}), **(fixed or {})}
    for name, default in first.items():
        if not node.has_parameter(name):
            _declare(node, kind, name, default, ignore_override=name in (fixed or {}))
    current = {n: plain(node.get_parameter(n).value) for n in first if is_parameter(kind, n)}
    return {name: value for name, value in current.items() if value is not None}


def _declare(node: Node, kind: type, name: str, default: Any, *, ignore_override: bool) -> None:

    # rclpy cannot infer the type of an empty list: it is set afterwards, as is a double.
    first = None if default == [] else default
    node.declare_parameter(name, first, ParameterDescriptor(dynamic_typing=True), ignore_override)
    present = node.get_parameter(name)
    final = _with_double(kind, ros_parameter(name, default) if present.value is None else present)
    if final.type_ != present.type_:
        node.set_parameters([final])
    # ``read`` reports values out of range.
    with contextlib.suppress(InvalidParameterValueException):
        node.set_descriptor(name, descriptor(kind, name))


def _with_double(kind: type, parameter: Parameter) -> Parameter:
    """Return a parameter of the dataclass ``kind``, with an integer for a double converted."""
    value, leaf = plain(parameter.value), value_type(kind, parameter.name)
    if leaf and leaf.base is float and value not in (None, []):
        with contextlib.suppress(ValueError):  # ``read`` reports it
            return ros_parameter(parameter.name, ros_value(leaf, leaf.checked(value)))
    return parameter


def set_doubles(node: Node, kind: type) -> None:
    """Convert integers that are set for doubles of the dataclass ``kind`` on ``node``."""
    node.add_pre_set_parameters_callback(lambda given: [_with_double(kind, item) for item in given])


def refuse_undeclared(node: Node, kind: type) -> None:
    """Reject unknown parameters, with a message that names them and suggests others.

    rclpy would reject them without naming them. Integers for doubles are set as doubles.
    """

    def check(parameters: list[Parameter]) -> list[Parameter]:
        names = [item.name for item in parameters if not node.has_parameter(item.name)]
        if names:
            texts = {problem.key: problem.text for problem in unknown_parameters(kind, names)}
            error = ParameterNotDeclaredException(names)
            lines = (f"{name}: {texts.get(name, 'no such parameter')}" for name in names)
            error.args = ("\n".join(lines),)
            raise error
        return [_with_double(kind, item) for item in parameters]

    node.add_pre_set_parameters_callback(check)


def follow_changes(
    node: Node,
    check: Callable[[list[Parameter]], object],
    apply: Callable[[list[Parameter]], None],
) -> None:
    """Follow changes of a node's parameters.

    Args:
        node: the node with the parameters.
        check: called before they are set; raises OneBotError, with the reason, to reject them.
        apply: called after they were set.
    """

    def validate(parameters: list[Parameter]) -> SetParametersResult:
        try:
            check(parameters)
        except OneBotError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    node.add_on_set_parameters_callback(validate)
    node.add_post_set_parameters_callback(apply)


def descriptor(kind: type, name: str) -> ParameterDescriptor:
    """Return what a node publishes about the parameter ``name`` of the dataclass ``kind``."""
    result = ParameterDescriptor(dynamic_typing=True)
    leaf = value_type(kind, name)
    if leaf is None:
        return result
    rule = leaf.rule
    result.description, result.read_only = rule.description, rule.read_only
    result.additional_constraints = leaf.wanted()
    if leaf.many or rule.nan or not rule.range:
        return result
    low = rule.at_least if rule.above is None else rule.above
    bounds = {"from_value": low, "to_value": rule.at_most}
    ends = {end: leaf.base(value) for end, value in bounds.items() if value is not None}
    if leaf.base is float:
        widest = {"from_value": -sys.float_info.max, "to_value": sys.float_info.max}
        result.floating_point_range = [FloatingPointRange(**{**widest, **ends})]
    elif leaf.base is int:
        widest = {"from_value": -(2**63), "to_value": 2**63 - 1, "step": 1}
        result.integer_range = [IntegerRange(**{**widest, **ends})]
    return result


def ros_parameter(name: str, value: Any) -> Parameter:
    """Return a parameter with the type of ``value``; None unsets it."""
    if value == []:
        return Parameter(name, Parameter.Type.STRING_ARRAY, [])
    return Parameter(name, value=value)
