"""The messages between a steering page and its server: JSON in WebSocket text frames.

Page to server, each with a ``type``:
    drive: ``stamp`` (ms), ``linear`` (m/s), ``angular`` (rad/s); sent repeatedly while a control
        is held, even if nothing changes: the robot stops after a timeout. The stamp is that of the
        newest state (or welcome): the server's own clock comes back to it, so it knows how old a
        command is at most without comparing clocks.
    release: the control was released.
    stop: the stop button; every page loses control, and the robot is locked until one drives.
    topic: ``topic``, the name of the command topic to publish on.
    limits: ``linear`` (m/s), ``angular`` (rad/s), chosen for all pages; null for the robot's own.

Server to page: ``welcome`` (``id``, ``rate``, ``stamp``), ``state`` (see ``state_text``) and
``error`` (``message``; ``about``, the type of the refused message; ``field``, the one that is
wrong).
"""

import json
import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NoReturn

from onebot_description.errors import OneBotError

MAX_LENGTH = 1024  # characters, ten times the longest message of a page
_TOPIC = re.compile(r"(~/|/)?[A-Za-z_][A-Za-z0-9_]*(/[A-Za-z_][A-Za-z0-9_]*)*")
_MAX_TOPIC = 200  # characters


class ProtocolError(OneBotError):
    """A message of a page is invalid; the text describes how."""

    def __init__(self, problem: str, field: str | None = None) -> None:
        """Make the error, about no type of message yet.

        Args:
            problem: what is wrong.
            field: the one that is wrong, if it is one.
        """
        super().__init__(problem)
        self.field = field
        self.about: str | None = None  # the type of the message, if it has one


@dataclass(frozen=True)
class Velocity:
    """A command: ``linear`` in m/s forward, ``angular`` in rad/s to the left (REP-103)."""

    linear: float = 0.0
    angular: float = 0.0

    def clamped(self, least: "Velocity", most: "Velocity") -> "Velocity":
        """Return the fastest command between ``least`` and ``most`` along the same arc.

        One factor scales both speeds. Clamping each on its own would change the radius: a robot
        that cannot turn as commanded would leave its arc to the outside, at full speed.
        """
        linear = min(max(self.linear, least.linear), most.linear)
        angular = min(max(self.angular, least.angular), most.angular)
        shares = _share(linear, self.linear), _share(angular, self.angular)
        share = min(shares)
        # What is at its limit is that limit exactly, without the rounding of a product.
        return Velocity(
            linear if shares[0] == share else self.linear * share,
            angular if shares[1] == share else self.angular * share,
        )


def _share(clamped: float, wanted: float) -> float:
    return clamped / wanted if wanted else 1.0


@dataclass(frozen=True)
class Drive:
    """A control is held."""

    velocity: Velocity
    stamp: float  # s, by the server's time.monotonic(): the page sent it after that


@dataclass(frozen=True)
class Release:
    """The control was released."""


@dataclass(frozen=True)
class Stop:
    """The stop button was pressed."""


@dataclass(frozen=True)
class ChooseTopic:
    """Publish commands on this topic from now on."""

    topic: str


@dataclass(frozen=True)
class SetLimits:
    """Limits of commands that an operator chose, each above zero; None for the robot's own."""

    linear: float | None = None  # m/s
    angular: float | None = None  # rad/s


Message = Drive | Release | Stop | ChooseTopic | SetLimits

_FIELDS: Mapping[str, frozenset[str]] = {
    "drive": frozenset({"stamp", "linear", "angular"}),
    "release": frozenset(),
    "stop": frozenset(),
    "topic": frozenset({"topic"}),
    "limits": frozenset({"linear", "angular"}),
}


def parse(text: str) -> Message:
    """Return the message that a page sent.

    Raises:
        ProtocolError: it is none of the messages above, or a number is not finite.
    """
    fields = json_object(text)
    kind = fields.pop("type", None)
    if not isinstance(kind, str) or kind not in _FIELDS:
        raise ProtocolError(f"the type must be one of {', '.join(_FIELDS)}")
    try:
        return _message(kind, fields)
    except ProtocolError as error:
        error.about = kind
        raise


def _message(kind: str, fields: Mapping[str, Any]) -> Message:
    if set(fields) != _FIELDS[kind]:
        needed = ", ".join(sorted(_FIELDS[kind])) or "no fields"
        raise ProtocolError(f'a message of type "{kind}" has {needed} beside its type, no others')
    if kind == "drive":
        linear, angular, stamp = (finite_number(n, fields) for n in ("linear", "angular", "stamp"))
        return Drive(Velocity(linear, angular), stamp / 1000.0)
    if kind == "topic":
        return ChooseTopic(_topic(fields["topic"]))
    if kind == "limits":
        return SetLimits(_limit("linear", fields), _limit("angular", fields))
    return Release() if kind == "release" else Stop()


def json_object(text: str, most: int = MAX_LENGTH) -> dict[str, Any]:
    """Return the fields of a JSON object with ``most`` characters.

    Raises:
        ProtocolError: it is too long, or none.
    """
    if len(text) > most:
        raise ProtocolError(f"a message has at most {most} characters")
    try:
        found = json.loads(text, parse_constant=_refuse, object_pairs_hook=_unique)
        json.dumps(found, ensure_ascii=False).encode()
    except UnicodeEncodeError:
        raise ProtocolError("a message must be Unicode, without half characters") from None
    except (ValueError, RecursionError):
        raise ProtocolError("a message must be JSON, with finite numbers") from None
    if not isinstance(found, dict):
        raise ProtocolError("a message must be a JSON object")
    return found


def _refuse(name: str) -> NoReturn:
    raise ProtocolError(f"{name} is not valid JSON")


def _unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) < len(pairs):
        raise ProtocolError("a field was given twice")
    return found


def finite_number(name: str, fields: Mapping[str, Any]) -> float:
    """Return a field that is a finite number.

    Raises:
        ProtocolError: it is none.
    """
    value = fields[name]
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise ProtocolError(f"{name} must be a number", name)
    try:
        number = float(value)
    except OverflowError:
        number = math.inf
    if not math.isfinite(number):
        raise ProtocolError(f"{name} must be a finite number", name)
    return number


def _limit(name: str, fields: Mapping[str, Any]) -> float | None:
    if fields[name] is None:
        return None
    limit = finite_number(name, fields)
    if limit <= 0.0:
        raise ProtocolError(f"{name} must be above zero", name)
    return limit


def _topic(value: object) -> str:
    if not isinstance(value, str) or not _TOPIC.fullmatch(value) or len(value) > _MAX_TOPIC:
        raise ProtocolError("topic must be the name of a ROS topic, such as /cmd_vel", "topic")
    return value


def stamp_of(now: float) -> int:
    """Return the stamp of a message that is sent at ``now``, s by time.monotonic()."""
    return int(now * 1000.0)


def welcome_text(page: str, rate: float, stamp: int) -> str:
    """Return the first message to a page: its name, and the rate of commands in Hz."""
    return json.dumps({"type": "welcome", "id": page, "rate": rate, "stamp": stamp})


def error_text(message: str, about: str | None = None, field: str | None = None) -> str:
    """Return an error message for a page.

    Args:
        message: one sentence.
        about: the type of the page's message that was refused, if it has one.
        field: of that message, the one that is wrong, if it is one.
    """
    return json.dumps({"type": "error", "message": message, "about": about, "field": field})


def velocity_fields(velocity: Velocity) -> dict[str, float]:
    """Return the fields of a velocity in a state message."""
    return {"linear": velocity.linear, "angular": velocity.angular}


def state_text(fields: Mapping[str, Any]) -> str:
    """Return a state message for a page.

    Args:
        fields: ``stamp``, ``received`` (how many messages came from this page), ``late`` (its
            commands are too old to drive by), ``driver`` (the name of the page that drives, or
            None), ``you``, ``pages``,
            ``topic``, ``topic_type``, ``topics``, ``robots`` (``name`` and ``topic`` of each),
            ``listeners``, ``others`` (nodes that publish commands, too), ``locked``,
            ``controllers``, ``limits`` (in force), ``chosen``, ``ceiling``, ``ceiling_from``,
            ``braking``, ``command``, ``odometry``, ``camera`` (the topic of pictures), ``obstacle``
            (m until the robot meets what its scan sees, None if nothing) and ``view``.
    """
    return json.dumps({"type": "state", **fields}, allow_nan=False)
