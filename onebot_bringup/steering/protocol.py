"""The messages between a steering page and its server: JSON in WebSocket frames.

A page sends the messages in ``MESSAGES``, each with its name as ``type``. The server sends
``welcome`` (the page's ``id`` and ``stamp``), ``state`` ten times a second (see
``SteeringServer``), and ``error`` (``message``, one sentence; ``about``, the type of the rejected
message).
"""

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Flag, auto
from typing import Any, NamedTuple, TypeVar

from onebot_description.errors import OneBotError
from onebot_description.geometry.poses import clamp
from onebot_description.parameters.reader import REQUIRED, ConfigError, parameter, read

T = TypeVar("T")

MAX_LENGTH = 1024  # characters, ten times the longest message that a page sends


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

    linear: float = parameter(REQUIRED, "m/s")
    angular: float = parameter(REQUIRED, "rad/s")
    stamp: float = parameter(REQUIRED, "s, by the server's boot_time()")
    joints: Mapping[str, float] = parameter({}, "velocities of joints by name, rad/s or m/s")
    lateral: float = parameter(0.0, "m/s")

    @property
    def command(self) -> Command:
        joints = {name: velocity for name, velocity in self.joints.items() if velocity}
        return Command(Velocity(self.linear, self.angular, self.lateral), joints)


@dataclass(frozen=True)
class Release:
    """The control was released."""


@dataclass(frozen=True)
class Stop:
    """The stop button: every page loses control, and the robot is locked until one drives."""


@dataclass(frozen=True)
class ChooseTopic:
    """Publish commands on this topic from now on."""

    topic: str = parameter(REQUIRED, "its name", not_empty=True)


@dataclass(frozen=True)
class SetLimits:
    """Limits of commands that an operator chose for all pages; None for the robot's own."""

    linear: float | None = parameter(None, "m/s", above=0.0)
    angular: float | None = parameter(None, "rad/s", above=0.0)
    lateral: float | None = parameter(None, "m/s", above=0.0)


Message = DriveMessage | Release | Stop | ChooseTopic | SetLimits

MESSAGES: Mapping[str, type[Message]] = {
    "drive": DriveMessage,
    "release": Release,
    "stop": Stop,
    "topic": ChooseTopic,
    "limits": SetLimits,
}
"""The messages that a page may send."""


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
    try:
        return _checked(MESSAGES[kind], fields)
    except ProtocolError as error:
        error.about = kind
        raise


def read_request(kind: type[T], data: str) -> T:
    """Parse a JSON object as a dataclass of parameters.

    Raises:
        ProtocolError: it is invalid.
    """
    return _checked(kind, _json_object(data))


def _checked(kind: type[T], fields: Mapping[str, Any]) -> T:
    try:
        return read(kind, fields)
    except ConfigError as error:
        raise ProtocolError(error.problems[0].message()) from None


def _json_object(data: str | bytes) -> dict[str, Any]:
    try:
        fields = json.loads(data)
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
