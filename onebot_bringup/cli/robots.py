"""Which robots run, and which of them a command is about."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

from onebot_bringup.cli.session import PATIENCE, Session
from onebot_description.errors import OneBotError, did_you_mean, listing

if TYPE_CHECKING:
    from onebot_bringup.steering.command_topic import CommandedRobot

_DESCRIPTION = "robot_description"
COMMANDS = "velocity_controller/cmd_vel"  # of a robot that is not chosen, and not there yet


def description_topics(session: Session, within: str = "") -> list[str]:
    """Return the topics of the robots that run in a namespace and below; its own robot's first."""
    there = [
        name
        for name, _ in session.topics()
        if name.startswith(f"{within}/") and name.endswith(f"/{_DESCRIPTION}")
    ]
    found = filter(session.node.count_publishers, there)
    return sorted(found, key=lambda name: (name.count("/"), name))


def commanded_robots(session: Session) -> "list[CommandedRobot]":
    """Return the robots that take commands in the session's namespace and below."""
    from onebot_bringup.steering.command_topic import commanded_robots

    own = session.node.get_namespace().rstrip("/")
    return [each for each in commanded_robots(session.node) if each.topic.startswith(f"{own}/")]


def chosen_commands(session: Session, name: str, *, first: bool = False) -> str:
    """Return the full name of the topic of commands that the user means.

    Args:
        session: whose node discovers the robots.
        name: of a robot, such as "robot2", or of a topic; "" for the only robot.
        first: of several robots, take the first one where none is named.

    Raises:
        OneBotError: there are several robots, and none of them is named.
    """
    if name.startswith("/"):
        return session.full_name(name)
    if not name:
        session.discover()  # one that is found first may not be the only one
        session.spin(lambda: commanded_robots(session), PATIENCE)
        return _only(commanded_robots(session), first) or session.full_name(COMMANDS)
    topic = session.full_name(name)

    def named() -> list[str]:
        found = commanded_robots(session)
        return [each.topic for each in found if topic == each.topic or name == each.name]

    if found := session.look_for(named, f'the robot or the topic "{name}"'):
        return str(found[0])
    others = [each.name for each in commanded_robots(session)]
    if others and "/" not in name and not session.node.count_subscribers(topic):
        raise OneBotError(
            f'no robot "{name}" takes commands{did_you_mean(name, others, "robots")}; '
            f"for a topic of that name write /{name}"
        )
    return topic


def _only(robots: "Sequence[CommandedRobot]", first: bool) -> str:
    if len(robots) > 1 and not first:
        names = [each.name for each in robots]
        raise OneBotError(
            f"{len(names)} robots take commands: {listing(names)}; choose one by its name, or by "
            "its topic of commands"
        )
    return robots[0].topic if robots else ""
