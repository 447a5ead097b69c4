"""Makes the messages that the nodes of a robot would publish, to show it without nodes or ROS."""

from collections.abc import Sequence

from onebot_description.arrays import Floats
from onebot_description.description import Description
from onebot_description.model import RobotModel
from onebot_description.model.robot_model import JointArrays
from onebot_description.ros.wire.cdr import Writer

Published = tuple[str, str, bytes]
"""A topic, its type's name, and a serialized message."""


def published_description(topic: str, urdf: str) -> Published:
    """Return a description as it is published on a topic."""
    message = Writer()
    message.string(urdf)
    return topic, "std_msgs/msg/String", bytes(message.data)


def published_transforms(
    topic: str, stamp_ns: int, parents: Sequence[str], children: Sequence[str], values: Floats
) -> Published:
    """Return transforms as they are published on a topic.

    Args:
        topic: /tf or /tf_static.
        stamp_ns: their time, nanoseconds.
        parents: the parent of each frame.
        children: the frames.
        values: (N, 7) poses of the frames in their parents: x y z in m, and a quaternion x y z w.
    """
    message = Writer()
    message.u32(len(parents))
    for parent, child, pose in zip(parents, children, values.tolist(), strict=True):
        message.stamp(stamp_ns)
        message.string(parent)
        message.string(child)
        message.doubles(pose)
    return topic, "tf2_msgs/msg/TFMessage", bytes(message.data)


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
        return [
            published_description(f"{self._space}robot_description", self._description.urdf),
            self._transforms("/tf_static", stamp_ns, fixed, fixed.constant),
        ]

    def moving(self, stamp_ns: int, positions: Floats) -> list[Published]:
        """Return the messages of the joints' positions.

        Args:
            stamp_ns: the time, nanoseconds.
            positions: (M,) positions of the movable joints in the model's order, rad or m.
        """
        moving = self.model.moving
        state = Writer()
        state.stamp(stamp_ns)
        state.string("")  # the header's frame
        state.u32(len(self.model.joints))
        for name in self.model.joints:
            state.string(name)
        nothing: list[float] = []  # no velocities, no efforts
        for values in (positions.tolist(), nothing, nothing):
            state.u32(len(values))
            state.doubles(values)
        return [
            self._transforms("/tf", stamp_ns, moving, moving.transforms(positions)),
            (f"{self._space}joint_states", "sensor_msgs/msg/JointState", bytes(state.data)),
        ]

    def _transforms(
        self, topic: str, stamp_ns: int, joints: JointArrays, values: Floats
    ) -> Published:
        parents, children = (
            [self._prefix + link for link in links] for links in (joints.parents, joints.children)
        )
        return published_transforms(topic, stamp_ns, parents, children, values)
