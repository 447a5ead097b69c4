"""Publishes the state of a drive on ~/controller_state, like the standard controllers."""

from collections.abc import Callable, Mapping
from typing import Any

from builtin_interfaces.msg import Time
from rclpy.node import Node

from onebot_control.drive.drive import Drive
from onebot_control.drive.mecanum import MecanumParameters
from onebot_control.drive.parameters import DriveParameters
from onebot_control.drive.steered import SteeringControllerParameters
from onebot_control.drive.wheels.rollers import MecanumWheels
from onebot_control.physics import JointStates
from onebot_description.ros.topic_qos import DEPTH
from onebot_description.ros.wire.interfaces import load_interface

Indices = Mapping[str, int]
"""The index of each joint in the joint states, by name."""


class DriveStatePublisher:
    """Publishes the state of one drive, if its type has one. Only used by the control thread."""

    def __init__(self, node: Node, config: DriveParameters[Any]) -> None:
        """Create the publisher.

        Args:
            node: node of the robot.
            config: the drive's parameters, whose type determines the message.
        """
        self._publisher = None
        for kind, (name, fill) in _STATES.items():
            if isinstance(config, kind):
                self._kind, self._fill = load_interface(name), fill
                self._publisher = node.create_publisher(self._kind, "~/controller_state", DEPTH)

    def publish(self, drive: Drive, joints: tuple[str, ...], states: JointStates, at: Time) -> None:
        """Publish the state, if there are subscribers.

        Args:
            drive: the drive.
            joints: names of the joints in ``states``.
            states: the measured joint states.
            at: the stamp.
        """
        if self._publisher is None or not self._publisher.get_subscription_count():
            return
        message = self._kind()
        message.header.stamp = at
        message.header.frame_id = drive.config.base_frame_id or drive.wheels.description.root_link
        indices = {name: index for index, name in enumerate(joints)}
        self._fill(message, drive, indices, states)
        self._publisher.publish(message)


def _fill_mecanum(message: Any, drive: Drive, indices: Indices, states: JointStates) -> None:
    """Write the measured velocity of the first wheel at each corner, and the limited command."""
    wheels = drive.wheels
    assert isinstance(wheels, MecanumWheels)
    corners = "front_left", "front_right", "back_right", "back_left"
    for corner, [name, *_] in zip(corners, wheels.corners, strict=True):
        velocity = wheels.directions[name] * states.velocities[indices[name]]
        setattr(message, f"{corner}_wheel_velocity", velocity)
    twist = message.reference_velocity
    twist.linear.x, twist.linear.y, twist.angular.z = drive.command[:3]


def _fill_steering(message: Any, drive: Drive, indices: Indices, states: JointStates) -> None:
    """Write the measured states and the commands of the wheels and the steering."""
    wheels = drive.wheels
    traction = [(indices[name], wheels.directions[name]) for name in wheels.names]
    message.traction_wheels_position = [sign * states.positions[index] for index, sign in traction]
    message.traction_wheels_velocity = [sign * states.velocities[index] for index, sign in traction]
    message.steer_positions = [states.positions[indices[name]] for name in wheels.steering]
    message.linear_velocity_command = [*drive.command.wheels]
    message.steering_angle_command = drive.steering


Fill = Callable[[Any, Drive, Indices, JointStates], None]
_STATES: Mapping[type, tuple[str, Fill]] = {
    MecanumParameters: ("control_msgs/msg/MecanumDriveControllerState", _fill_mecanum),
    SteeringControllerParameters: ("control_msgs/msg/SteeringControllerStatus", _fill_steering),
}
