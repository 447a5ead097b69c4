"""The values in a saved view, checked: each function returns one, or says what would be right."""

import re
from typing import Any

from onebot_bringup.viewer.geometry import Vector

PANEL_STATES = ("hidden", "collapsed", "expanded")
SPEED_TYPES = ("auto", "Twist", "TwistStamped", "Odometry")
Color = tuple[int, int, int]

# Relative, so that a namespace applies; absolute only where it is written so.
_TOPIC = re.compile(r"/?[A-Za-z_]\w*(/[A-Za-z_]\w*)*", re.ASCII)


def boolean(value: object, where: str) -> bool:
    """Check true or false."""
    if not isinstance(value, bool):
        raise ValueError(f'{where} must be true or false, not "{value}"')
    return value


def length(value: Any, where: str) -> float:
    """Check a number of at least 0."""
    if not _is_number(value) or not 0 <= value < float("inf"):
        raise ValueError(f'{where} must be a number of at least 0, such as 0.5, not "{value}"')
    return float(value)


def height(value: Any, where: str) -> float:
    """Check metres up, or down if negative."""
    if not _is_number(value) or not abs(value) < float("inf"):
        raise ValueError(f'{where} must be metres, such as -0.05, not "{value}"')
    return float(value)


def text(value: object, where: str) -> str:
    """Check a name."""
    if not isinstance(value, str):
        raise ValueError(f'{where} must be a name, not "{value}"')
    return value


def names(value: Any, where: str) -> tuple[str, ...]:
    """Check a list of names."""
    if not isinstance(value, list) or not all(isinstance(name, str) for name in value):
        raise ValueError(
            f'{where} must be a list of names, such as [odom, base_link], not "{value}"'
        )
    return tuple(value)


def topic(value: object, where: str) -> str:
    """Check the name of a topic."""
    if not isinstance(value, str) or not _TOPIC.fullmatch(value):
        raise ValueError(
            f'{where} must be a topic, such as velocity_controller/odom, not "{value}"'
        )
    return value


def vector(value: Any, where: str) -> Vector | None:
    """Check three metres, or nothing."""
    if value is None or value == []:
        return None
    numbers = isinstance(value, list) and len(value) == 3 and all(map(_is_number, value))
    if not numbers or not all(abs(number) < float("inf") for number in value):
        raise ValueError(f'{where} must be three metres, such as [3.0, -3.0, 2.0], not "{value}"')
    return float(value[0]), float(value[1]), float(value[2])


def color(value: Any, where: str) -> Color | None:
    """Check three sRGB bytes, or nothing."""
    if value is None or value == []:
        return None
    three = isinstance(value, list) and len(value) == 3
    if not three or not all(type(number) is int and 0 <= number <= 255 for number in value):
        raise ValueError(f'{where} must be three bytes, such as [48, 48, 48], not "{value}"')
    return value[0], value[1], value[2]


def panel(value: object, where: str) -> str:
    """Check the state of a panel."""
    return _one_of(value, PANEL_STATES, where)


def speed_type(value: object, where: str) -> str:
    """Check the type of messages that carry a speed."""
    return _one_of(value, SPEED_TYPES, where)


def _one_of(value: object, choices: tuple[str, ...], where: str) -> str:
    if value not in choices:
        raise ValueError(f'{where} must be one of {", ".join(choices)}, not "{value}"')
    return str(value)


def _is_number(value: object) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool)
