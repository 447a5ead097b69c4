"""Finds the running robots, and the one that a command means."""

from collections.abc import Iterable
from contextlib import suppress
from typing import TYPE_CHECKING

from onebot_bringup.cli.session import PATIENCE, Session
from onebot_description.errors import OneBotError, did_you_mean, listing

if TYPE_CHECKING:
    from onebot_bringup.steering.command_topic import CommandedRobot

_DESCRIPTION = "/robot_description"
_COMMANDS = "velocity_controller/cmd_vel"  # the topic if no robot is there yet


def description_topics(session: Session, within: str = "") -> list[str]:
    """Return the description topics of robots in a namespace and below, its own robot's first."""
    topics = session.published("std_msgs/msg/String", _DESCRIPTION, within)
    return sorted(topics, key=lambda name: (name.count("/"), name))


def frame_prefix(session: Session, nodes: Iterable[str]) -> str | None:
    """Return the parameter frame_prefix of the first of these nodes that has it."""
    from onebot_bringup.introspection.parameter_client import ParameterClient
    from onebot_bringup.introspection.parameter_values import NOT_SET

    for name in nodes:
        with suppress(OneBotError):  # a node without parameters
            [value] = ParameterClient(session, name).values(["frame_prefix"])
            if value.type != NOT_SET:
                return str(value.string_value)
    return None


def commanded_robots(session: Session) -> "list[CommandedRobot]":
    """Return the robots that take commands in the session's namespace and below."""
    from onebot_bringup.steering.command_topic import commanded_robots

    robots = commanded_robots(session.node)
    return [robot for robot in robots if robot.topic.startswith(f"{session.space}/")]


def chosen_commands(session: Session, name: str, *, first: bool = False) -> str:
    """Return the full name of the command topic that the user means.

    Args:
        session: the session that discovers the robots.
        name: the name of a robot, such as "robot2", or of a topic; "" for the only robot.
        first: if there are several robots and none is named, take the first.

    Raises:
        OneBotError: there are several robots, and none of them is named.
    """
    if name.startswith("/"):
        return session.full_name(name)
    if not name:
        session.discover()  # there may be more than the first robot found
        session.spin(lambda: commanded_robots(session), PATIENCE)
        robots = commanded_robots(session)
        if len(robots) > 1 and not first:
            raise OneBotError(
                f"{len(robots)} robots take commands: {listing(robot.name for robot in robots)}; "
                "choose one by its name or by its command topic"
            )
        return robots[0].topic if robots else session.full_name(_COMMANDS)
    topic = session.full_name(name)

    def named() -> list[str]:
        robots = commanded_robots(session)
        return [robot.topic for robot in robots if robot.topic == topic or robot.name == name]

    if topics := session.look_for(named, f'the robot or the topic "{name}"'):
        return str(topics[0])
    names = [robot.name for robot in commanded_robots(session)]
    if names and "/" not in name and not session.node.count_subscribers(topic):
        raise OneBotError(
            f'no robot "{name}" takes commands{did_you_mean(name, names, "robots")}; '
            f"for a topic of that name write /{name}"
        )
    return topic
