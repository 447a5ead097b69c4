"""The topics and services that move a robot and its odometry, and pause its world."""

import math
from collections.abc import Callable
from functools import partial
from typing import Any

from geometry_msgs.msg import PoseStamped, PoseWithCovariance
from rclpy.node import Node
from std_srvs.srv import SetBool, Trigger

from onebot_control.runtime.control_loop import LoopSlot
from onebot_description.errors import OneBotError
from onebot_description.geometry.poses import PlanarPose, yaw_of
from onebot_description.ros.topic_qos import DEPTH
from onebot_description.ros.wire.interfaces import load_interface
from onebot_description.timing.throttled import Warn

_FARTHEST_POSE = 1e9  # m; beyond it, odometry would not be exact to the micrometer


class RobotServices:
    """Topics and services that move a robot and its odometry, and pause its world.

    The topic ~/teleport and the services ~/reset, ~/reset_odometry and ~/set_odometry apply to the
    robot, the services ~/pause and ~/step to its world.
    """

    def __init__(
        self, node: Node, slot: LoopSlot, odom_frame: Callable[[], str] | None, warn: Warn
    ) -> None:
        """Subscribe, and offer the services.

        Args:
            node: node of the robot.
            slot: slot of the robot.
            odom_frame: returns the frame of the odometry; None for a robot without odometry, and
                so without ~/set_odometry and ~/reset_odometry.
            warn: logs a warning, given a key and a text.
        """
        self._slot, self._odom_frame, self._warn = slot, odom_frame or (lambda: ""), warn
        node.create_subscription(PoseStamped, "~/teleport", self._on_teleport, DEPTH)
        services: dict[str, Callable[[], object]] = {
            "reset": lambda: slot.robot.reset(),
            "step": lambda: slot.running.step(),
        }
        if odom_frame:
            services["reset_odometry"] = lambda: slot.robot.place_odometry(PlanarPose())
            kind = load_interface("control_msgs/srv/SetOdometry")
            node.create_service(kind, "~/set_odometry", self._on_set_odometry)
        for service, action in services.items():
            node.create_service(Trigger, f"~/{service}", partial(self._on_trigger, action))
        node.create_service(SetBool, "~/pause", self._on_pause)

    def _on_teleport(self, message: PoseStamped) -> None:
        pose, frame = planar_pose(message), message.header.frame_id
        if fault := self._slot.fault(lambda: self._teleport(frame, pose)):
            self._warn("teleport", f"~/teleport is ignored: {fault}")

    def _teleport(self, frame: str, pose: PlanarPose) -> None:
        robot = self._slot.robot
        world, odom = robot.world_frame, self._odom_frame()
        frame = frame or world or odom  # may be "" with a fixed base, which has no odometry
        if odom and frame == odom:
            pose = robot.odom_in_world.compose(pose)
        elif frame != world:
            frames = " or ".join(filter(None, (world, odom))) or "none"
            raise OneBotError(f'there is no frame "{frame}"; write {frames}')
        robot.teleport(pose)

    def _on_set_odometry(self, request: Any, answer: Any) -> Any:
        pose = PlanarPose(request.x, request.y, request.yaw)
        if not all(abs(value) <= _FARTHEST_POSE for value in pose):
            answer.success, answer.message = False, "the pose is not finite, or too far away"
            return answer
        return self._on_trigger(lambda: self._slot.robot.place_odometry(pose), request, answer)

    def _on_pause(self, request: SetBool.Request, answer: SetBool.Response) -> SetBool.Response:
        return self._on_trigger(lambda: self._slot.running.pause(request.data), request, answer)

    def _on_trigger(self, action: Callable[[], object], _: Any, answer: Any) -> Any:
        answer.message = self._slot.fault(action)
        answer.success = not answer.message
        return answer


def planar_pose(message: PoseStamped | PoseWithCovariance) -> PlanarPose:
    """Return a pose seen from above; yaw is NaN if the quaternion is not normalized."""
    p, q = message.pose.position, message.pose.orientation
    norm = q.x * q.x + q.y * q.y + q.z * q.z + q.w * q.w
    yaw = yaw_of(q.x, q.y, q.z, q.w) if 0.98 < norm < 1.02 else math.nan
    return PlanarPose(p.x, p.y, yaw)
