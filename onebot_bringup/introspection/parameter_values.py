"""Converts parameter values to text and back, like ``ros2 param``.

Values are rcl_interfaces/msg/ParameterValue, whose ``type`` is one of the numbers named here.
"""

import array
import json
import math
from collections.abc import Sequence
from typing import Any

import yaml

from onebot_description.errors import OneBotError
from onebot_description.parameters import bounded_yaml
from onebot_description.parameters.values import INT64

NOT_SET, BOOL, INTEGER, DOUBLE, STRING = range(5)
BYTES, BOOLS, INTEGERS, DOUBLES, STRINGS = range(5, 10)

# For each type: the field of ParameterValue, the label of `param get`, the name in `param list`.
_TYPES: dict[int, tuple[str, str, str]] = {
    BOOL: ("bool_value", "Boolean value is:", "boolean"),
    INTEGER: ("integer_value", "Integer value is:", "integer"),
    DOUBLE: ("double_value", "Double value is:", "double"),
    STRING: ("string_value", "String value is:", "string"),
    BYTES: ("byte_array_value", "Byte values are:", "byte array"),
    BOOLS: ("bool_array_value", "Boolean values are:", "boolean array"),
    INTEGERS: ("integer_array_value", "Integer values are:", "integer array"),
    DOUBLES: ("double_array_value", "Double values are:", "double array"),
    STRINGS: ("string_array_value", "String values are:", "string array"),
}


def value_of(value: Any) -> Any:
    """Return the value within a ParameterValue, arrays as in rclpy; None if it is not set."""
    return getattr(value, _TYPES[value.type][0]) if value.type in _TYPES else None


def label(value: Any) -> str:
    """Return the label before the value, such as ``Double value is:``."""
    return _TYPES[value.type][1] if value.type in _TYPES else "Parameter not set."


def type_label(kind: int) -> str:
    """Return the name of a type, such as ``double``."""
    return _TYPES[kind][2] if kind in _TYPES else "not set"


def text_of(value: Any) -> str:
    """Return a ParameterValue as YAML that ``parse_value`` reads; "" if it is not set."""
    plain = _yaml_value(value_of(value))
    if plain is None:
        return ""
    if isinstance(plain, str) and _unquoted(plain) == plain:
        return plain
    return quoted(plain)


def quoted(value: Any) -> str:
    """Return a plain value, such as one from a file, as YAML that ``parse_value`` reads."""
    if isinstance(value, str):
        return json.dumps(value)
    text = yaml.safe_dump(value, default_flow_style=True, width=math.inf, allow_unicode=True)
    return text.removesuffix("\n").removesuffix("\n...")


def parse_value(text: str, declared: int = NOT_SET) -> tuple[str, int, Any]:
    """Parse a value in YAML.

    ROS parameters are strictly typed: an integer is converted if a double is declared, and any
    text if a string is declared.

    Args:
        text: the value in YAML.
        declared: the type of the parameter; NOT_SET if unknown.

    Returns:
        The field of ParameterValue, the type and the value.

    Raises:
        OneBotError: no type can hold the value.
    """
    if declared == STRING:
        kind, value = STRING, _unquoted(text)
    else:
        kind, value = _inferred(text, _load(text))
        kind, value = _adapted(kind, value, declared)
    return _TYPES[kind][0], kind, value


def is_finite(value: Any) -> bool:
    """Whether a value, or list of values, contains neither infinities nor NaN."""
    values = value if isinstance(value, list) else [value]
    return all(math.isfinite(number) for number in values if isinstance(number, float))


def _unquoted(text: str) -> str:
    """Remove quotes as YAML does, and change nothing else."""
    content = _load(text)
    return content if isinstance(content, str) and text.strip()[:1] in "'\"" else text


def _load(text: str) -> Any:
    try:
        return bounded_yaml.load(text)
    except yaml.YAMLError:
        return text  # invalid YAML is a string, as in rclpy


def _inferred(text: str, value: Any) -> tuple[int, Any]:
    if isinstance(value, bool):
        return BOOL, value
    if isinstance(value, int):
        return INTEGER, _int64(value)
    if isinstance(value, float):
        return DOUBLE, value
    if isinstance(value, list):
        return _inferred_list(value)
    return STRING, value if isinstance(value, str) else text


def _inferred_list(values: list[Any]) -> tuple[int, Any]:
    kinds = {type(value) for value in values}
    if kinds <= {str}:
        return STRINGS, values
    if kinds == {bool}:
        return BOOLS, values
    if kinds == {int}:
        return INTEGERS, [_int64(value) for value in values]
    if kinds <= {int, float}:
        return DOUBLES, [float(value) for value in values]
    raise OneBotError(f"a list has values of one type only, not {values}")


def _adapted(kind: int, value: Any, declared: int) -> tuple[int, Any]:
    if kind == INTEGER and declared == DOUBLE:
        return DOUBLE, float(value)
    if kind == INTEGERS and declared == DOUBLES:
        return DOUBLES, [float(number) for number in value]
    if kind == STRINGS and not value and declared in (BYTES, BOOLS, INTEGERS, DOUBLES):
        return declared, []
    return kind, value


def _int64(value: int) -> int:
    if value not in INT64:
        raise OneBotError(f"{value} is too large for an integer parameter (64 bits)")
    return value


def dump(node: str, names: Sequence[str], values: Sequence[Any]) -> str:
    """Return the parameters of a node that have a value as the text of a parameter file."""
    tree: dict[str, Any] = {}
    for name, value in zip(names, values, strict=True):
        if value.type == NOT_SET:
            continue  # rcl cannot read a file that contains a null
        *groups, last = name.split(".")
        if any(name.startswith(f"{prefix}.") for prefix in names):
            groups, last = [], name  # both "a" and "a.b" are parameters
        level = tree
        for group in groups:
            level = level.setdefault(group, {})
        level[last] = _yaml_value(value_of(value))
    return yaml.safe_dump({node: {"ros__parameters": tree}}, default_flow_style=False)


def _yaml_value(value: Any) -> Any:
    if isinstance(value, array.array):
        return value.tolist()
    if isinstance(value, (list, tuple)):
        return [item[0] if isinstance(item, bytes) else item for item in value]
    return value
