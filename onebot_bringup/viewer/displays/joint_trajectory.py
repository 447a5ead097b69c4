"""Draws joint trajectories (trajectory_msgs/JointTrajectory) as the path of a link they move."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from onebot_bringup.viewer.core.drawing import Archetypes, Drawing, TopicSettings
from onebot_bringup.viewer.core.inbox import WantedTopic
from onebot_bringup.viewer.core.rerun_limits import LARGEST, SELDOM, drawable
from onebot_bringup.viewer.core.settings import Color, color, setting
from onebot_bringup.viewer.core.shown_robot import ShownRobot
from onebot_bringup.viewer.core.stage import Stage
from onebot_bringup.viewer.displays.joint_plot import JOINT_STATE
from onebot_description.arrays import Floats
from onebot_description.elements.urdf import MOVING_KINDS, Description, Joint
from onebot_description.errors import OneBotError, did_you_mean
from onebot_description.model.robot_model import RobotModel
from onebot_description.ros.wire.message_arrays import JointStateArrays

# Maximum number of points drawn; in a longer trajectory they are chosen evenly, first to last.
_MAX_POINTS = 1000
# Maximum number of positions added between the points, so that the line bends with the robot.
_MAX_BETWEEN = 1000
_STEP = np.radians(5.0)  # distance of two positions, summed over all joints


@dataclass(frozen=True)
class JointTrajectorySettings(TopicSettings):
    """Paths of links along joint trajectories."""

    link: str = setting("", "the link whose path it is; empty: the last one that the joints move")
    color: Color | None = setting(None, "sRGB bytes; empty: automatic", color)
    line_width: float = setting(0.0, "meters; 0: a few pixels")


class JointTrajectoryDrawing(Drawing[JointTrajectorySettings]):
    """The path of a link in the robot's root frame; an empty trajectory clears it."""

    key = "joint_trajectory"
    message_types = ("trajectory_msgs/msg/JointTrajectory",)
    stamped_when_sent, has_header = False, False
    repeat_when_silent = True
    period_ns = SELDOM

    @classmethod
    def further_topics(cls, stage: Stage, topic: str) -> Sequence[WantedTopic]:
        states = stage.robot_of(topic).full_name("joint_states")
        return [WantedTopic(states, (JOINT_STATE,), optional=True)]

    @cached_property
    def robot(self) -> ShownRobot:
        """The robot whose joints the trajectory moves."""
        return self.stage.robot_of(self.name)

    def style(self) -> Sequence[rr.AsComponents]:
        # Negative radii are in pixels.
        width, colors = self.settings.line_width, [self.color]
        return [
            rr.LineStrips3D.from_fields(colors=colors, radii=[width / 2 or -1.0]),
            rr.Points3D.from_fields(colors=colors, radii=[width or -3.0]),
        ]

    def add(self, stamp_ns: int, message: Any) -> None:
        """Add a trajectory, or store the current joint positions of the robot."""
        if not isinstance(message, JointStateArrays):
            super().add(stamp_ns, message)
        elif len(message.positions) == len(message.names):
            states = zip(message.names, message.positions.tolist(), strict=True)
            self.robot.joint_positions.update(states)

    def frame_of(self, message: Any) -> str:
        """Return the frame of the robot's root link, in which joint positions place the links."""
        return self.robot.root_frame

    def _is_due(self, frame: str, stamp_ns: int) -> bool:
        return bool(frame) and super()._is_due(frame, stamp_ns)  # it waits for the description

    def draw(self, message: Any) -> Archetypes:
        """Return the path as a line, and the link's places at the trajectory's points."""
        if not len(message.points):
            return _shapes([], [])
        robot = self.robot
        assert robot.description is not None
        try:
            motion = LinkMotion(robot.description, message.joint_names, self.settings.link)
        except OneBotError as error:
            raise ValueError(str(error)) from None
        along, at_points = samples(_positions(message), motion.turning)
        places = motion.places(along, robot.joint_positions)
        line = drawable(places)
        return _shapes([line] if len(line) else [], drawable(places[at_points]))


def _shapes(strips: Any, points: Any) -> Archetypes:
    return [
        rr.LineStrips3D.from_fields(strips=strips),
        rr.Points3D.from_fields(positions=points),
    ]


# --- trajectories ---------------------------------------------------------------------------------


def _positions(message: Any) -> Floats:
    """Return the positions (N, K) of K joints at the points to draw, rad or m.

    Raises:
        ValueError: positions are missing or not finite.
    """
    names, lists = message.joint_names, message.points.positions
    wrong = np.flatnonzero(lists.counts != len(names))
    if len(wrong):
        at = int(wrong[0])
        raise ValueError(f"point {at} has {lists.counts[at]} positions for {len(names)} joints")
    rows = np.linspace(0, len(lists) - 1, min(len(lists), _MAX_POINTS)).astype(int)
    positions = np.array([lists[row] for row in rows.tolist()])
    bad = np.argwhere(~(np.abs(positions) <= LARGEST))
    if len(bad):
        at, joint = rows[bad[0, 0]], names[bad[0, 1]]
        raise ValueError(f'at point {at} the position of joint "{joint}" is not finite')
    return positions


def samples(positions: Floats, turning: NDArray[np.bool_]) -> tuple[Floats, NDArray[np.intp]]:
    """Interpolate the points of a trajectory linearly.

    Args:
        positions: (N, K) positions of K joints, rad or m.
        turning: (K,), which joints turn; the others move the link straight and add no samples.

    Returns:
        Positions (S, K), at most some degrees apart, and the N rows that are the given points.
    """
    turned = np.abs(np.diff(positions, axis=0))[:, turning].sum(axis=1)
    step = max(_STEP, turned.sum() / _MAX_BETWEEN)
    counts = np.maximum(np.ceil(turned / step), 1).astype(int)
    rows = np.concatenate([[0], np.cumsum(counts)])
    along = np.arange(rows[-1] + 1)
    columns = [np.interp(along, rows, column) for column in positions.T]
    return np.stack(columns, axis=1), rows


# --- kinematics -----------------------------------------------------------------------------------


class LinkMotion:
    """Kinematics of a link that some joints move, while the others are held.

    Attributes:
        turning: (K,), which of the joints that move the link turn.
    """

    def __init__(self, description: Description, names: Sequence[str], link: str) -> None:
        """Choose the link.

        Args:
            description: the robot.
            names: the joints that move.
            link: the link; "" for the last one that the joints move.

        Raises:
            OneBotError: the robot has no such joint or link, or its links are not one tree.
        """
        self._names = names
        self._model = model = RobotModel(description)
        self.turning = model.moving.half_turns[[model.row(name) for name in names]] > 0.0
        self._free = {joint.name for joint in description.moving_joints if joint.mimic is None}
        above = {joint.child: joint for joint in description.joints}
        link = link or last_link(above, model.followers(names))
        if link not in model.links:
            hint = did_you_mean(link, model.links, "links")
            raise OneBotError(f'robot "{model.name}" has no link "{link}"{hint}')
        self._link = model.links.index(link)

    def places(self, positions: Floats, states: Mapping[str, float]) -> Floats:
        """Return where the link is.

        Args:
            positions: (N, K) positions of the joints that move it, rad or m.
            states: current positions by joint name, rad or m; held joints not in it are at rest.

        Returns:
            Its places (N, 3) in the frame of the root link, m.
        """
        model = self._model
        known: dict[str, Any] = {
            joint: position
            for joint, position in states.items()
            if joint in self._free and abs(position) <= LARGEST
        }
        known.update(zip(self._names, positions.T, strict=True))
        everything = np.tile(model.pose({}), (len(positions), 1))
        for joint, leader in model.followers(known).items():
            place = known[leader.joint] * leader.multiplier + leader.offset
            everything[:, model.row(joint)] = place
        places: Floats = model.link_poses(everything)[:, self._link, :3]
        return places


def last_link(above: Mapping[str, Joint], moved: Collection[str]) -> str:
    """Return the link at the end of the chain with the most ``moved`` joints, the longest if equal.

    Links behind another joint that can move by itself, such as the fingers of a gripper, do not
    count.

    Args:
        above: the joint above each link except the root link.
        moved: the names of the moved joints.
    """
    movable = [joint for joint in above.values() if joint.kind in MOVING_KINDS]
    free = (joint.parent for joint in movable if joint.mimic is None)
    inner = {joint.name for link in free for joint in joints_above(above, link)}
    ends = {joint.name for joint in movable}.difference(inner, moved)

    def reach(link: str) -> tuple[int, int]:
        chain = [joint.name for joint in joints_above(above, link)]
        return sum(name in moved for name in chain), len(chain) if ends.isdisjoint(chain) else 0

    return max(above, key=reach)


def joints_above(above: Mapping[str, Joint], link: str) -> list[Joint]:
    """Return the joints from a link up to the root link; for ``above`` see ``last_link``."""
    joints = []
    while link in above:
        joints.append(above[link])
        link = above[link].parent
    return joints
