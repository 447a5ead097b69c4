"""Makes the messages that the nodes of a robot would publish, to show it without nodes."""

from collections.abc import Sequence
from typing import Any

from rclpy.serialization import serialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import Header, String

from onebot_description.arrays import Floats
from onebot_description.description import Description
from onebot_description.model import RobotModel
from onebot_description.model.robot_model import JointArrays
from onebot_description.ros.wire.definition import type_name
from onebot_description.ros.wire.messages import time_message, transforms_message

Published = tuple[str, str, bytes]
"""A topic, its type's name, and a message."""


def published(topic: str, message: Any) -> Published:
    """Return a message as it comes on a topic."""
    return topic, type_name(message), bytes(serialize_message(message))


def published_transforms(
    topic: str, stamp_ns: int, parents: Sequence[str], children: Sequence[str], values: Floats
) -> Published:
    """Return transforms as they come on a topic.

    Args:
        topic: /tf or /tf_static.
        stamp_ns: their time, nanoseconds.
        parents: the parent of each frame.
        children: the frames.
        values: (N, 7) poses of the frames in their parents: x y z in m, and a quaternion x y z w.
    """
    message = transforms_message(time_message(stamp_ns), parents, children, values)
    return published(topic, message)


class RobotMessages:
    """The messages of one robot.

    Attributes:
        model: the robot's kinematics.
    """

    def __init__(self, description: Description, name: str = "") -> None:
        """Make messages of a robot; ``name`` is its namespace and prefixes its frames."""
        self._description, self._prefix = description, f"{name}/" if name else ""
        self._space = f"/{name}/" if name else ""
        self.model = RobotModel.from_description(description)

    @property
    def root(self) -> str:
        """The frame of the root link."""
        return self._prefix + self._description.root_link

    def standing(self, stamp_ns: int) -> list[Published]:
        """Return the description, and the transforms of the fixed joints."""
        fixed = self.model.fixed
        text = String(data=self._description.urdf)
        return [
            published(f"{self._space}robot_description", text),
            self._transforms("/tf_static", stamp_ns, fixed, fixed.constant),
        ]

    def moving(self, stamp_ns: int, positions: Floats) -> list[Published]:
        """Return the messages of the joints' positions.

        Args:
            stamp_ns: the time, nanoseconds.
            positions: (M,) positions of the movable joints in the model's order, rad or m.
        """
        moving, header = self.model.moving, Header(stamp=time_message(stamp_ns))
        state = JointState(header=header, name=self.model.joints, position=positions.tolist())
        return [
            self._transforms("/tf", stamp_ns, moving, moving.transforms(positions)),
            published(f"{self._space}joint_states", state),
        ]

    def _transforms(
        self, topic: str, stamp_ns: int, joints: JointArrays, values: Floats
    ) -> Published:
        parents, children = (
            [self._prefix + link for link in links] for links in (joints.parents, joints.children)
        )
        return published_transforms(topic, stamp_ns, parents, children, values)
