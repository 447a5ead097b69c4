"""Draws the running robots for ``onebot snapshot``."""

from argparse import Namespace
from collections.abc import Sequence
from typing import TYPE_CHECKING

from onebot_bringup.cli.running_robots import description_topics, frame_prefix
from onebot_bringup.cli.session import Session
from onebot_bringup.viewer.core.shown_robot import (
    ROBOT_DESCRIPTION,
    WORLD_DESCRIPTION,
    RobotToShow,
)
from onebot_bringup.viewer.robot_view import RobotView
from onebot_bringup.viewer.topics import ViewFeed
from onebot_bringup.viewer.view_source import ViewSource
from onebot_control.conventions import namespace_prefix
from onebot_description.description import Description
from onebot_description.errors import OneBotError, listing
from onebot_description.ros.run_node import steady_timer

if TYPE_CHECKING:
    import rerun as rr

# Seconds to wait for descriptions and frames, which take less even on a busy machine.
_FRAMES = 6.0
_TICK = 0.05  # seconds between two ticks
_MESSAGES = 1.0  # seconds to wait for topics that are seldom published
_LISTED = 5


def record_running(args: Namespace, recording: "rr.RecordingStream") -> list[str]:
    """Log the running robots as they are now; return a sentence per thing that is not drawn."""
    with Session(args.ros_args) as session:
        robots = running_robots(session)
        return RunningRobots(session, args.view, recording, robots).record()


class RunningRobots:
    """Shows running robots until all of their links have a transform."""

    def __init__(
        self,
        session: Session,
        view: str,
        recording: "rr.RecordingStream",
        robots: Sequence[RobotToShow],
    ) -> None:
        """Subscribe, relative to the session's namespace; for ``view`` see ``ViewSource``."""
        self._session, self._robots = session, robots
        self._warnings: list[str] = []
        self._source = ViewSource(view, self._warnings.append)
        self._view = RobotView(
            recording,
            self._source.view,
            robots=robots,
            resolve=session.node.resolve_topic_name,
            report=self._report,
        )
        self._feed = ViewFeed(session.node, self._view)
        self._broken: OneBotError | None = None  # the error of an invalid description
        self._timer = steady_timer(session.node, _TICK, self._tick)

    def _report(self, _: str, error: Exception) -> None:
        if isinstance(error, OneBotError):
            self._broken = error  # other bad messages are no reason to give up

    def _tick(self) -> None:
        """Show the received messages."""
        self._warnings += self._feed.update()
        warnings = self._feed.tick()
        self._warnings += warnings if self._view.robot is not None else []

    def await_descriptions(self) -> Description:
        """Return the first robot's description, once every robot has one."""
        count = len(self._robots)
        self._session.spin(lambda: len(self._view.robots) >= count or self._broken, _FRAMES)
        lacking = [str(robot) for robot in self._robots if str(robot) not in self._view.robots]
        if self._broken is not None and lacking:
            raise self._broken
        if self._view.robot is None or lacking:
            raise OneBotError(
                f"no description of the robots in {listing(lacking)} within {_FRAMES:.0f} s"
            )
        return self._view.robot

    def record(self) -> list[str]:
        """Log the robots as they are now; return a sentence per thing that could not be drawn."""
        robot = self.await_descriptions()
        if self._source.set_robot(robot.robot_name):
            self._warnings += self._view.set_view(self._source.view)
        self._tick()
        view, feed = self._view, self._feed

        def is_complete() -> bool:
            world = self._session.node.count_publishers(WORLD_DESCRIPTION)
            lacks_world = world and WORLD_DESCRIPTION not in feed.received
            return not (lacks_world or view.stage.missing) and view.stage.has_fixed_frame

        def notice() -> str:
            missing = view.stage.missing or [view.stage.view_frame]
            return f"waiting for the frames of {listing(missing, _LISTED)} ..."

        self._session.await_or_report(is_complete, notice, _FRAMES)
        if view.stage.missing:
            frames = listing(view.stage.frames.names)
            raise OneBotError(
                f"no transform of {listing(view.stage.missing, _LISTED)} within {_FRAMES:.0f} s "
                f"(frames received: {frames}): are joint_states published, and is the simulation "
                "not paused?"
            )

        def has_all() -> bool:
            return feed.received.issuperset(item.topic for item in view.offered if item.visible)

        # Only briefly, since some topics are seldom published.
        self._session.spin(has_all, _MESSAGES)
        self._timer.cancel()
        return [*dict.fromkeys(self._warnings), *view.finish()]


def running_robots(session: Session) -> list[RobotToShow]:
    """Return the robots that run in the session's namespace and below, with their prefixes."""
    topic = session.full_name(ROBOT_DESCRIPTION)
    topics = session.look_for(
        lambda: description_topics(session, session.space), f"a robot on {topic}"
    )
    if not topics:
        raise OneBotError(
            f"no robot is running: nothing on {topic} (elsewhere: "
            f"{listing(description_topics(session))}); start one (onebot_bringup), name its URDF "
            "or xacro file, or its namespace: --ros-args -r __ns:=/NAMESPACE"
        )
    session.discover()
    topics = description_topics(session, session.space) or topics
    robots = []
    for topic in topics:
        space, prefix = topic.rpartition("/")[0], frame_prefix(session, session.publishers(topic))
        if prefix is None:  # if there are several robots, each has a different one
            prefix = namespace_prefix(space) if len(topics) > 1 else ""
        robots.append(RobotToShow(space, prefix, plotted=len(topics) == 1))
    return robots
