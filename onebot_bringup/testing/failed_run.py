"""Shows the end of a failed test's simulation: a recording for Rerun, and a picture of it."""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from rclpy.serialization import serialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from onebot_bringup.viewer.core.inbox import DESCRIPTION
from onebot_bringup.viewer.core.shown_robot import ROBOT_DESCRIPTION, WORLD_DESCRIPTION, RobotToShow
from onebot_bringup.viewer.core.transforms import TF
from onebot_bringup.viewer.display_server import open_recording
from onebot_bringup.viewer.displays.joint_plot import JOINT_STATE
from onebot_bringup.viewer.rendering import render
from onebot_bringup.viewer.robot_view import RobotView
from onebot_bringup.viewer.view_config import ViewConfig
from onebot_control.nodes.publishing import scene_transforms
from onebot_control.poses import WORLD_FRAME, Transform
from onebot_control.simulation import SimulatedRobot, Simulation
from onebot_description.arrays import Floats
from onebot_description.description import Description
from onebot_description.errors import OneBotError
from onebot_description.model import RobotModel
from onebot_description.model.robot_model import JointArrays
from onebot_description.ros.wire.interfaces import TFMessage
from onebot_description.ros.wire.messages import time_message, transforms_message

if TYPE_CHECKING:
    import rerun as rr

# A topic, its type's name, and a message.
Published = tuple[str, str, bytes]


def show_failed_run(simulation: Simulation, base: Path) -> list[Path]:
    """Write the kept end of a simulation to files.

    Args:
        simulation: the simulation, whose ``keep`` was called.
        base: the path of the files without a suffix; existing files are replaced.

    Returns:
        The files: .rrd, and .png if it can be drawn.

    Raises:
        OneBotError: it cannot be recorded.
    """
    recorded, picture = (base.with_name(f"{base.name}{ending}") for ending in (".rrd", ".png"))
    base.parent.mkdir(parents=True, exist_ok=True)
    recording = open_recording(save=recorded)
    try:
        _record(simulation, recording.stream)
    finally:
        recording.close()
    with suppress(OneBotError):
        render(recorded, picture, progress=lambda _: None)
        return [recorded, picture]
    return [recorded]


def _record(simulation: Simulation, stream: "rr.RecordingStream") -> None:
    robots = [_ShownRobot(name, robot) for name, robot in simulation.robots.items()]
    names = [robot.names for robot in robots]
    view = RobotView(stream, ViewConfig(fixed_frame=WORLD_FRAME), robots=names, from_start=True)
    world, moments = simulation.world, simulation.kept
    messages: list[Published] = []
    if moments:
        start = moments[0].stamp
        messages += (message for robot in robots for message in robot.standing(start))
        if world is not None:
            messages.append(_text(WORLD_DESCRIPTION, world))
            messages.append(_tf("/tf_static", scene_transforms(world, WORLD_FRAME, start)))
    for moment in moments:
        for robot, pose, joints in zip(robots, moment.poses, moment.joints, strict=True):
            messages += robot.moving(moment.stamp, pose, joints)
        if moment.boxes:
            boxes, poses = [*moment.boxes], [*moment.boxes.values()]
            messages.append(
                _transforms("/tf", moment.stamp, [WORLD_FRAME] * len(boxes), boxes, _rows(poses))
            )
        for topic, kind, data in messages:
            view.take(topic, kind, data, moment.stamp)
        messages.clear()
        view.tick(moment.stamp)
    view.finish()


class _ShownRobot:
    """Makes a robot's messages as its nodes would publish them."""

    def __init__(self, name: str, robot: SimulatedRobot) -> None:
        self._prefix = f"{name}/" if name else ""
        self.names = RobotToShow(f"/{name}" if name else "", self._prefix, plotted=not name)
        self._description = robot.description
        self._model = RobotModel.from_description(self._description)

    def standing(self, stamp: int) -> list[Published]:
        """Return its description, and the transforms of its fixed joints."""
        fixed = self._model.fixed
        return [
            _text(self.names.topic(ROBOT_DESCRIPTION), self._description),
            self._transforms("/tf_static", stamp, fixed, fixed.constant),
        ]

    def moving(
        self, stamp: int, pose: Transform, positions: Mapping[str, float]
    ) -> list[Published]:
        """Return the messages of its pose and its joints' positions.

        Args:
            stamp: the time, nanoseconds.
            pose: the pose of its root link.
            positions: joint positions by name, rad or m.
        """
        moving = self._model.moving
        message = JointState(name=[*positions], position=[*positions.values()])
        message.header.stamp = time_message(stamp)
        root = self._prefix + self._description.root_link
        values = moving.transforms(self._model.positions(positions))
        return [
            _transforms("/tf", stamp, [WORLD_FRAME], [root], _rows([pose])),
            self._transforms("/tf", stamp, moving, values),
            (self.names.topic("joint_states"), JOINT_STATE.name, bytes(serialize_message(message))),
        ]

    def _transforms(self, topic: str, stamp: int, joints: JointArrays, values: Floats) -> Published:
        parents, children = (
            [self._prefix + link for link in links] for links in (joints.parents, joints.children)
        )
        return _transforms(topic, stamp, parents, children, values)


def _rows(poses: Sequence[Transform]) -> Floats:
    """Return poses as (N, 7): x y z in m, and a quaternion x y z w."""
    return np.array([np.hstack(pose) for pose in poses])


def _text(topic: str, description: Description) -> Published:
    return topic, DESCRIPTION.name, bytes(serialize_message(String(data=description.urdf)))


def _transforms(
    topic: str, stamp: int, parents: Sequence[str], children: Sequence[str], values: Floats
) -> Published:
    return _tf(topic, transforms_message(time_message(stamp), parents, children, values))


def _tf(topic: str, message: TFMessage) -> Published:
    return topic, TF.name, bytes(serialize_message(message))
