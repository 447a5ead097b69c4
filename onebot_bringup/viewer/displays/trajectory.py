"""Trajectories of joints (trajectory_msgs/JointTrajectory) as a ghost that drives them.

The ghost is the links that the joints move, translucent, at the link that carries them. It is
shown from the trajectory's start, moves at the times of its points, linearly between them, and
vanishes a second after the last. Another trajectory replaces it, and one without points ends it.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from onebot_bringup.viewer.columns import time_column
from onebot_bringup.viewer.displays.display import LARGEST, REPEAT_AFTER, Context, below
from onebot_bringup.viewer.displays.message_display import (
    Drawing,
    Look,
    MessageDisplay,
    topic_entity,
)
from onebot_bringup.viewer.settings import Color, color, fraction, setting
from onebot_bringup.viewer.shapes import load_shape
from onebot_description.description import Description
from onebot_description.errors import OneBotError, listing
from onebot_description.model import RobotModel
from onebot_description.model.quaternions import from_rpy, multiply, rotate

Floats = NDArray[np.float64]

_STEP = 0.05  # seconds between two poses, at most
_MOST_POSES = 2000  # of one trajectory
_STAYS_NS = 1_000_000_000  # after the last point
_LONGEST = 86400.0  # seconds
_GLB = "model/gltf-binary"


@dataclass(frozen=True)
class TrajectoryLook(Look):
    """A ghost of the robot that drives a trajectory."""

    color: Color | None = setting(None, "sRGB bytes; by default one of ours a topic", color)
    alpha: float = setting(0.4, "opacity, 0 to 1", fraction)


class Motion(NamedTuple):
    """A trajectory, by samples."""

    times: Floats  # (K,) seconds from its start
    positions: Mapping[str, Floats]  # (K,) of each joint, rad or m


class _Part(NamedTuple):
    """A visual of the ghost."""

    entity: str
    frame: str  # in which its poses are
    glb: bytes
    places: Floats  # (K, 3)
    turns: Floats  # (K, 4)


class _Play(NamedTuple):
    """The trajectory that the ghost drives."""

    parts: Sequence[_Part]
    stamps_ns: NDArray[np.int64]  # (K,)
    end_ns: int


class TrajectoryDrawing(Drawing[TrajectoryLook]):
    """The ghost of one topic."""

    stamped = False

    def __init__(self, robots: Sequence[Context], *arguments: Any) -> None:
        super().__init__(*arguments)
        self._robots = robots
        self._model: tuple[Description, RobotModel] | None = None  # the last one used
        self._play: _Play | None = None
        self._next = 0  # its sample to log
        self._shapes: dict[str, str] = {}  # entities that are shown, and their frames
        self._shapes_ns = 0

    def draw(self, message: Any) -> Sequence[rr.AsComponents]:
        """Begin a trajectory; ``flush`` logs what of it is due.

        Raises:
            ValueError: it is not consistent, or no robot has its joints.
        """
        motion, start_ns = sampled(message), self.stamp_ns
        parts = [] if motion is None else list(self._parts(motion))
        self._log_until(min(start_ns, self.context.now_ns()))
        if motion is None or not parts:
            self._play = None
            self._show(start_ns, [])
            return ()
        stamps = start_ns + np.round(1e9 * motion.times).astype(np.int64)
        self._play, self._next = _Play(parts, stamps, int(stamps[-1]) + _STAYS_NS), 0
        return ()

    def retry(self) -> None:
        """Draw the last message for a robot that has come."""
        if self._last is not None and self._play is None:
            self._pending.append(self._last)

    def flush(self) -> None:
        """Log what is due."""
        super().flush()
        self._log_until(self.context.now_ns())

    # --- what is logged -------------------------------------------------------------------------

    def _log_until(self, now_ns: int) -> None:
        play = self._play
        if play is None or not all(self.context.connected(part.frame) for part in play.parts):
            return
        due = slice(self._next, int(np.searchsorted(play.stamps_ns, now_ns, side="right")))
        if due.start < due.stop:
            if not self._next:
                self._show(int(play.stamps_ns[0]), play.parts)
            self._next = due.stop
            for part in play.parts:
                self.context.recording.send_columns(
                    part.entity,
                    indexes=[time_column(play.stamps_ns[due])],
                    columns=rr.InstancePoses3D.columns(
                        translations=part.places[due], quaternions=part.turns[due]
                    ),
                )
        if now_ns >= play.end_ns:
            self._play = None
            self._show(play.end_ns, [])

    def _show(self, stamp_ns: int, parts: Sequence[_Part]) -> None:
        """Log the shapes of these parts, if they are not there, and erase others."""
        shapes = {part.entity: part.frame for part in parts}
        if self._shapes and shapes != self._shapes:
            self._shapes = {}
            self.log(stamp_ns, rr.Clear(recursive=True))
        if self._shapes and stamp_ns - self._shapes_ns < REPEAT_AFTER * 1e9:
            return
        self._shapes, self._shapes_ns = shapes, stamp_ns
        color = (*(self.look.color or self.color), round(255 * self.look.alpha))
        for part in parts:
            frame = rr.CoordinateFrame(part.frame)
            self.context.recording.log(part.entity, frame, static=True)
            shape = rr.Asset3D(contents=part.glb, media_type=_GLB, albedo_factor=color)
            self.context.log_row(part.entity, stamp_ns, shape)

    # --- the ghost ------------------------------------------------------------------------------

    def _parts(self, motion: Motion) -> Iterator[_Part]:
        """Yield what the joints move; nothing while there is no robot.

        Raises:
            ValueError: no robot has the joints.
        """
        context, model = self._robot_of(motion.positions)
        if context is None or context.robot is None or model is None:
            return
        poses, carriers = _link_poses(model, motion), carriers_of(context.robot, model, motion)
        for link in context.robot.links:
            carrier = carriers.get(link.name)
            if carrier is None:
                continue
            frame = context.frame_of(carrier)
            places, turns = _within(poses[carrier], poses[link.name])
            for number, visual in enumerate(link.visuals):
                with suppress(OneBotError):  # the robot itself lacks it, and is warned of
                    glb = load_shape(visual.shape).glb
                    path = rr.new_entity_path([frame, link.name, str(number)]).lstrip("/")
                    turn, offset = from_rpy(visual.origin.rpy), np.array(visual.origin.xyz)
                    yield _Part(
                        below(self.entity, path),
                        frame,
                        glb,
                        places + rotate(turns, offset),
                        multiply(turns, turn),
                    )

    def _robot_of(self, joints: Mapping[str, object]) -> tuple[Context | None, RobotModel | None]:
        """Return the robot that has these joints; of several the one in the topic's namespace.

        Raises:
            ValueError: none has.
        """
        shown = [each for each in self._robots if each.robot is not None]
        shown.sort(key=lambda each: not self.topic.startswith(f"/{each.root}/"))
        for context in shown:
            model = self._model_of(context.robot)
            if model is not None and set(joints) <= set(model.joints):
                return context, model
        if shown:
            raise ValueError(f"no robot that is shown has the joints {listing(joints)}")
        return None, None

    def _model_of(self, robot: Description | None) -> RobotModel | None:
        if robot is not None and (self._model is None or self._model[0] is not robot):
            try:
                self._model = robot, RobotModel.from_description(robot)
            except OneBotError:  # its links are no tree
                return None
        return self._model[1] if self._model is not None else None


# --- trajectories ---------------------------------------------------------------------------------


def sampled(message: Any) -> Motion | None:
    """Return a trajectory's positions, often enough to be looked at; None without points.

    Raises:
        ValueError: it is not consistent.
    """
    joints, points = message.joint_names, message.points
    if not len(points):
        return None
    counts = set(points.positions.counts.tolist())
    if counts != {len(joints)} or len(set(joints)) != len(joints) or not joints:
        raise ValueError(
            f"it has {len(joints)} joints, and points of {listing(sorted(map(str, counts)))} "
            "positions: each joint must have one in each point"
        )
    duration = points.time_from_start
    times = duration.sec + 1e-9 * duration.nanosec
    positions = np.array([*points.positions], float)
    if not (np.abs(positions) <= LARGEST).all():
        raise ValueError("its positions are not finite")
    if (np.diff(times, prepend=0.0) < 0).any() or times[-1] > _LONGEST:
        raise ValueError("its times do not increase, or are negative or longer than a day")
    count = min(_MOST_POSES, math.ceil(times[-1] / _STEP) + 1)
    moments = np.linspace(0.0, times[-1], count)
    if len(times) <= _MOST_POSES:
        moments = np.unique(np.concatenate([moments, times]))
    columns = zip(joints, positions.T, strict=True)
    return Motion(moments, {name: np.interp(moments, times, column) for name, column in columns})


def carriers_of(robot: Description, model: RobotModel, motion: Motion) -> Mapping[str, str]:
    """Return the links that a motion moves, and the link above the first of its joints."""
    moved = {name for name in model.joints if model.follower(name, motion.positions) is not None}
    above = {joint.child: joint for joint in robot.joints}
    found: dict[str, str] = {}
    for link in robot.link_names:
        at = link
        while at in above:
            if above[at].name in moved:
                found[link] = above[at].parent
            at = above[at].parent
    return found


def _link_poses(model: RobotModel, motion: Motion) -> Mapping[str, Floats]:
    """Return the poses (K, 7) of all links; joints that are not in the motion are at 0."""
    positions = np.zeros((len(motion.times), len(model.joints)))
    for row, name in enumerate(model.joints):
        follower = model.follower(name, motion.positions)
        if follower is not None:
            source = motion.positions[follower.source]
            positions[:, row] = source * follower.multiplier + follower.offset
    return dict(zip(model.links, model.link_poses(positions).swapaxes(0, 1), strict=True))


def _within(frame: Floats, poses: Floats) -> tuple[Floats, Floats]:
    """Return the places and turns of ``poses`` in ``frame``, both (K, 7) in the same frame."""
    back = frame[:, 3:] * (-1.0, -1.0, -1.0, 1.0)
    return rotate(back, poses[:, :3] - frame[:, :3]), multiply(back, poses[:, 3:])


class TrajectoryDisplay(MessageDisplay[TrajectoryLook]):
    """Draws trajectories of joints as ghosts."""

    key = "trajectory"
    Look = TrajectoryLook
    draws = TrajectoryDrawing
    message_types = ("trajectory_msgs/msg/JointTrajectory",)
    live = False

    def __init__(self, *contexts: Context) -> None:
        super().__init__(*contexts)
        self._robots = contexts[1:]

    def make(self, name: str, settings: Any, color: Color) -> TrajectoryDrawing:
        """Return the ghost of a topic."""
        entity = topic_entity(self.key, name)
        return TrajectoryDrawing(self._robots, self.context, entity, settings, color)

    def set_robot(self) -> None:
        """Draw for a robot that has come what could not be drawn before."""
        for drawing in self.items.values():
            assert isinstance(drawing, TrajectoryDrawing)
            drawing.retry()
