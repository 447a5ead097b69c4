"""The messages between a steering page and its server: JSON in WebSocket frames.

A page sends the messages in ``MESSAGES``, each with its name as ``type``. The server sends
``welcome`` (the page's ``id`` and ``stamp``), ``state`` ten times a second (see
``SteeringServer``), and ``error`` (``message``, one sentence; ``about``, the type of the rejected
message).
"""

import json
import math
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import Flag, auto
from typing import Any, NamedTuple

from onebot_description.errors import OneBotError
from onebot_description.geometry.poses import clamp

MAX_LENGTH = 1024  # characters, ten times the longest message that a page sends
_TOPIC = re.compile(r"(~/|/)?[A-Za-z_][A-Za-z0-9_]*(/[A-Za-z_][A-Za-z0-9_]*)*")
_LONGEST_TOPIC = 200  # characters; DDS has a limit of 255


class ProtocolError(OneBotError):
    """A message of a page is invalid; the text describes how."""

    about: str | None = None  # the type of the message, if it has one


class Velocity(NamedTuple):
    """A planar velocity (REP-103)."""

    linear: float = 0.0  # m/s, forward
    angular: float = 0.0  # rad/s, to the left
    lateral: float = 0.0  # m/s, to the left

    @property
    def speed(self) -> float:
        """The speed in the direction of travel, m/s."""
        return math.hypot(self.linear, self.lateral)

    def at_most(self, other: "Velocity") -> "Velocity":
        """Return the lower speed of two limits along each axis."""
        return Velocity(*map(min, self, other))

    def clamped(self, low: "Velocity", high: "Velocity") -> "Velocity":
        """Return the fastest velocity between ``low`` and ``high`` along the same arc.

        One factor scales all speeds. Clamping each separately would change the radius: a robot
        that cannot turn as fast as commanded would leave its arc to the outside, at full speed.
        """
        clamped = [clamp(*speeds) for speeds in zip(self, low, high, strict=True)]
        shares = [_share(*speeds) for speeds in zip(clamped, self, strict=True)]
        scale = min(shares)
        # Clip, so that a speed at its limit is exact, without rounding errors of the product.
        return Velocity(
            *(
                limit if share == scale else speed * scale
                for limit, share, speed in zip(clamped, shares, self, strict=True)
            )
        )


def _share(clamped: float, speed: float) -> float:
    return clamped / speed if speed else 1.0


class Parts(Flag):
    """Parts of a robot, each with its lock."""

    NONE = 0
    WHEELS = auto()
    JOINTS = auto()
    ALL = WHEELS | JOINTS


@dataclass(frozen=True)
class Command:
    """A commanded motion of the robot."""

    velocity: Velocity = Velocity()
    # Velocities of joints by name, rad/s or m/s; other joints should be at rest.
    joints: Mapping[str, float] = field(default_factory=dict)

    @property
    def parts(self) -> Parts:
        """The parts that it moves."""
        wheels = Parts.NONE if self.velocity == Velocity() else Parts.WHEELS
        return wheels | Parts.JOINTS if self.joints else wheels


@dataclass(frozen=True)
class DriveMessage:
    """A control is held; sent repeatedly, since the robot stops after a timeout.

    The stamp is that of the newest state (or welcome). It comes from the server's own clock, so the
    server knows the maximum age of a command without comparing clocks.
    """

    linear: float  # m/s
    angular: float  # rad/s
    stamp: float  # s, by the server's boot_time(); ms in the message
    joints: Mapping[str, float]  # velocities of moving joints by name, rad/s or m/s
    lateral: float = 0.0  # m/s

    @property
    def command(self) -> Command:
        return Command(Velocity(self.linear, self.angular, self.lateral), self.joints)


@dataclass(frozen=True)
class Release:
    """The control was released."""


@dataclass(frozen=True)
class Stop:
    """The stop button: every page loses control, and the robot is locked until one drives."""


@dataclass(frozen=True)
class ChooseTopic:
    """Publish commands on this topic from now on."""

    topic: str


@dataclass(frozen=True)
class SetLimits:
    """Limits of commands that an operator chose for all pages; None for the robot's own."""

    linear: float | None = None  # m/s, above zero
    angular: float | None = None  # rad/s
    lateral: float | None = None  # m/s


Message = DriveMessage | Release | Stop | ChooseTopic | SetLimits
Check = Callable[[str, Any], Any]
"""Converts the JSON value of a field, given its name first; raises a ProtocolError."""


def number(name: str, value: Any) -> float:
    """Check that a field is a finite number, and return it."""
    if not isinstance(value, float) or not math.isfinite(value):
        raise ProtocolError(f"{name} must be a finite number")
    return value


def _seconds(name: str, value: Any) -> float:
    return number(name, value) / 1000.0


def _limit(name: str, value: Any) -> float | None:
    limit = None if value is None else number(name, value)
    if limit is not None and limit <= 0.0:
        raise ProtocolError(f"{name} must be above zero")
    return limit


def text(name: str, value: Any) -> str:
    """Check that a field is a non-empty text, and return it."""
    if not isinstance(value, str) or not value:
        raise ProtocolError(f"{name} must be a text")
    return value


def _joints(name: str, value: Any) -> dict[str, float]:
    if not isinstance(value, dict):
        raise ProtocolError(f"{name} must have velocities by the joints' names")
    velocities = {joint: number(name, velocity) for joint, velocity in value.items()}
    return {joint: velocity for joint, velocity in velocities.items() if velocity}


def _topic(name: str, value: Any) -> str:
    if isinstance(value, str) and len(value) <= _LONGEST_TOPIC and _TOPIC.fullmatch(value):
        return value
    raise ProtocolError(f"{name} must be the name of a ROS topic, such as /cmd_vel")


MESSAGES: Mapping[str, tuple[type[Message], Mapping[str, Check]]] = {
    "drive": (
        DriveMessage,
        {**dict.fromkeys(Velocity._fields, number), "stamp": _seconds, "joints": _joints},
    ),
    "release": (Release, {}),
    "stop": (Stop, {}),
    "topic": (ChooseTopic, {"topic": _topic}),
    "limits": (SetLimits, dict.fromkeys(Velocity._fields, _limit)),
}
"""The messages that a page may send, with the checks of their fields."""


def parse(data: str | bytes) -> Message:
    """Parse a message of a page.

    Raises:
        ProtocolError: it is invalid.
    """
    if len(data) > MAX_LENGTH:
        raise ProtocolError(f"a message has at most {MAX_LENGTH} characters")
    fields = _json_object(data)
    kind = fields.pop("type", None)
    if not isinstance(kind, str) or kind not in MESSAGES:
        raise ProtocolError(f"the type must be one of {', '.join(MESSAGES)}")
    message, checks = MESSAGES[kind]
    try:
        return message(**_checked(f'a message of type "{kind}", beside its type,', fields, checks))
    except ProtocolError as error:
        error.about = kind
        raise


def read_request(what: str, data: str, checks: Mapping[str, Check]) -> dict[str, Any]:
    """Parse a JSON object and check its fields.

    Args:
        what: what it is called in errors.
        data: the JSON text.
        checks: the check of each field.

    Raises:
        ProtocolError: it is invalid.
    """
    return _checked(what, _json_object(data), checks)


def _checked(what: str, fields: Mapping[str, Any], checks: Mapping[str, Check]) -> dict[str, Any]:
    if fields.keys() != checks.keys():
        raise ProtocolError(f"{what} has {', '.join(checks) or 'no fields'}, no others")
    return {name: check(name, fields[name]) for name, check in checks.items()}


def _json_object(data: str | bytes) -> dict[str, Any]:
    try:
        fields = json.loads(data, parse_int=float)
        json.dumps(fields, ensure_ascii=False).encode()  # no half characters
    except (ValueError, RecursionError):
        raise ProtocolError("a message must be JSON") from None
    if not isinstance(fields, dict):
        raise ProtocolError("a message must be a JSON object")
    return fields


def message_text(kind: str, **fields: Any) -> str:
    """Return the JSON text of a message of the server.

    Raises:
        ValueError: a number in it is not finite.
    """
    return json.dumps({"type": kind, **fields}, allow_nan=False)
