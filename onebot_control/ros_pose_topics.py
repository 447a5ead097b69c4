"""The topics that put velocity_controller's robot, or its odometry, somewhere else."""

import math
from collections.abc import Callable

from geometry_msgs.msg import PoseStamped
from rclpy.node import Node

from onebot_control.control_loop import ControlLoop
from onebot_control.frames import PlanarPose
from onebot_control.ros_messages import planar_pose
from onebot_description.errors import OneBotError

_DEPTH = 10  # ROS's system default


class PoseTopics:
    """~/teleport and ~/set_odometry."""

    def __init__(
        self,
        node: Node,
        robot: Callable[[], ControlLoop | None],
        odom_frame: Callable[[], str],
        warn: Callable[[str, str], None],
    ) -> None:
        """Subscribe.

        Args:
            node: of which the topics are.
            robot: returns the loop that drives the robot, None as long as there is no robot.
            odom_frame: returns the frame of the robot's odometry.
            warn: called with a key and a text to warn of.
        """
        self._robot, self._odom_frame, self._warn = robot, odom_frame, warn
        node.create_subscription(PoseStamped, "~/teleport", self._on_teleport, _DEPTH)
        node.create_subscription(PoseStamped, "~/set_odometry", self._on_set_odometry, _DEPTH)

    def _on_teleport(self, message: PoseStamped) -> None:
        self._with_pose("teleport", message, self._teleport)

    def _on_set_odometry(self, message: PoseStamped) -> None:
        self._with_pose("set_odometry", message, self._place_odometry)

    def _with_pose(
        self, topic: str, message: PoseStamped, use: Callable[[ControlLoop, str, PlanarPose], None]
    ) -> None:
        loop, pose = self._robot(), planar_pose(message)
        if loop is None:
            self._warn(topic, f"~/{topic} is ignored: there is no robot yet")
        elif not all(math.isfinite(value) for value in pose):
            text = "the pose is not finite, or its orientation no unit quaternion"
            self._warn(topic, f"~/{topic} is ignored: {text}")
        else:
            try:
                loop.call(lambda: use(loop, message.header.frame_id, pose))
            except (OneBotError, ValueError) as error:
                self._warn(topic, f"~/{topic} is ignored: {error}")

    def _teleport(self, loop: ControlLoop, frame: str, pose: PlanarPose) -> None:
        world, odom = loop.drive.config.world_frame_id, self._odom_frame()
        if frame == odom or not (frame or world):
            pose = loop.drive.origin.then(pose)
        elif frame not in ("", world):
            raise OneBotError(f'no frame "{frame}" here; write {world or odom} or {odom}')
        loop.drive.teleport(pose)

    def _place_odometry(self, loop: ControlLoop, frame: str, pose: PlanarPose) -> None:
        odom = self._odom_frame()
        if frame not in ("", odom):
            raise OneBotError(f'the odometry\'s frame is "{odom}", not "{frame}"')
        loop.drive.place_odometry(pose)
