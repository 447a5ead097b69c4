"""Moves the joints of the robot that is steered, with trajectories to their controllers.

Each command is a short trajectory that ends at rest, so the joints stop by themselves when no
further command follows. It begins at the stamp of the controller's own state, so the controller
itself rejects a delayed command, and no clocks are compared.
"""

import math
import threading
from collections.abc import Callable, Iterable, Mapping
from typing import Any

from rclpy.duration import Duration
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from onebot_bringup.steering.arbiter import ZEROS
from onebot_bringup.steering.command_topic import RobotLock
from onebot_bringup.steering.followed_topics import FollowedTopics, RobotNamespace
from onebot_bringup.steering.joint_motion import STEP, SteeredJoint, short_motion
from onebot_description.description import Description

_STATE = "control_msgs/msg/JointTrajectoryControllerState"
_STATE_TOPIC, _COMMAND_TOPIC = "controller_state", "joint_trajectory"
_LOCK = "controller_manager/cmd_vel"  # prefix of the lock of joints
_DEPTH = 10
_LIVE = 0.15  # s since the last state after which joints are not moved
_OLD = 1.0  # s since the last state after which positions are not shown

Joints = Mapping[str, SteeredJoint]


class JointCommands:
    """Moves the joints of the robot that is steered.

    ``publish``, ``lock`` and ``fields`` are called from any thread, ``needed`` from the node's.
    """

    def __init__(self, topics: FollowedTopics, locked: Callable[[bool], None]) -> None:
        """Follow nothing yet; ``locked`` is called when another node has changed the lock."""
        self._node, self._topics, self._locked = topics.node, topics, locked
        self._lock = threading.Lock()
        self._controllers: dict[str, _JointController] = {}  # controllers, by topic of the state
        self._description: Description | None = None
        self._joints: Joints = {}
        self._robot_lock: RobotLock | None = None

    def needed(
        self, namespace: RobotNamespace, description: Description | None, watched: bool
    ) -> dict[str, str]:
        """Return the topics of the robot's joint controllers; call this several times per second.

        Args:
            namespace: namespace of the robot.
            description: the robot's description, if it is known.
            watched: whether there is a page.
        """
        if description is not self._description:
            joints = description.moving_joints if description is not None else ()
            self._description = description
            self._joints = {joint.name: SteeredJoint.from_joint(joint) for joint in joints}
        needed = watched or any(controller.stopping for controller in self._controllers.values())
        topics = namespace.topics(self._node, {_STATE}) if needed else {}
        prefix = f"{namespace.name}/"
        self._follow({n for n in topics if n.removeprefix(prefix).count("/") == 1})
        self._update_lock(f"{namespace.name}/{_LOCK}")
        return dict.fromkeys(self._controllers, _STATE)

    def publish(self, velocities: Mapping[str, float]) -> None:
        """Move joints at these velocities, rad/s or m/s by name; stop others that moved."""
        with self._lock:
            for controller in self._controllers.values():
                controller.move(velocities, self._joints)

    @property
    def locked(self) -> bool:
        lock = self._robot_lock  # read once, since the node's thread may remove it meanwhile
        return lock is not None and lock.locked

    def lock(self, locked: bool) -> None:
        """Lock or unlock the joints; see ``RobotLock.set``."""
        with self._lock:
            if self._robot_lock is not None:
                self._robot_lock.set(locked)

    def fields(self) -> list[dict[str, Any]]:
        """Return the joints for the page's state: names, units, positions and maximum speeds.

        A position is None if it is currently unknown.
        """
        with self._lock:
            positions = {
                name: position
                for controller in self._controllers.values()
                for name, position in controller.positions().items()
            }
            joints = self._joints
        return [
            {"name": name, "unit": joint.unit, "max_speed": joint.max_speed, "position": position}
            for name, position in positions.items()
            if (joint := joints.get(name)) is not None and joint.max_speed
        ]

    def _follow(self, topics: set[str]) -> None:
        gone = self._controllers.keys() - topics
        new = {
            topic: _JointController(self._topics, topic)
            for topic in sorted(topics - self._controllers.keys())
            if topic.endswith(f"/{_STATE_TOPIC}")
        }
        with self._lock:
            closed = [self._controllers.pop(topic) for topic in gone]
            self._controllers.update(new)
        for controller in closed:
            controller.close()

    def _update_lock(self, topic: str) -> None:
        has_lock = self._node.count_publishers(f"{topic}_locked") > 0
        lock = self._robot_lock
        if lock is not None and not (has_lock and lock.topic == topic):
            with self._lock:
                self._robot_lock = None
            lock.close()
        elif lock is None and has_lock:
            self._robot_lock = RobotLock(self._node, topic, self._locked)


class _JointController:
    """A joint_trajectory_controller and the state of its joints."""

    def __init__(self, topics: FollowedTopics, topic: str) -> None:
        """Prepare its publisher; ``topic`` is the topic of its state."""
        self._node, self._topics, self._topic = topics.node, topics, topic
        commands = topic.removesuffix(_STATE_TOPIC) + _COMMAND_TOPIC
        self._publisher = self._node.create_publisher(JointTrajectory, commands, _DEPTH)
        self._names: tuple[str, ...] = ()  # its joints, in the order that pages show
        self.stopping = 0  # stop commands left to publish
        self._stop: JointTrajectory | None = None  # the stop command that is repeated

    def close(self) -> None:
        self._node.destroy_publisher(self._publisher)

    def positions(self) -> dict[str, float | None]:
        """Return the measured positions of its joints; None for currently unknown ones."""
        known_state = self._state(_OLD)
        if known_state is None:
            return dict.fromkeys(self._names)
        state, _ = known_state
        self._names = tuple(state.joint_names)
        positions = zip(self._names, state.feedback.positions, strict=False)
        return {name: place if math.isfinite(place) else None for name, place in positions}

    def move(self, velocities: Mapping[str, float], joints: Joints) -> None:
        """Move those of its joints that have a velocity, and stop the others if it moved any."""
        moves = any(name in joints and velocities.get(name) for name in self._names)
        if not (moves or self.stopping):
            return
        self.stopping = ZEROS if moves else self.stopping - 1
        message = None if moves else self._stop
        if message is None and (live_state := self._state(_LIVE)) is not None:
            message = _trajectory(*live_state, velocities, joints)
        # Repeat a stop unchanged: a new one from a state before it would let the joints go on.
        self._stop = None if moves else message
        if message is not None:  # otherwise, the previous trajectory ends at rest
            self._publisher.publish(message)

    def _state(self, max_age: float) -> tuple[Any, float] | None:
        """Return its latest state and the state's age, s; None if older than ``max_age``."""
        newest = self._topics.newest(self._topic)
        age = newest.age
        return (newest.message, age) if newest.message is not None and age <= max_age else None


def _trajectory(
    state: Any, age: float, velocities: Mapping[str, float], joints: Joints
) -> JointTrajectory | None:
    """Return a trajectory that moves joints at velocities, from a controller's reference state.

    It is None if the reference is invalid.
    """
    names, reference = list(state.joint_names), state.reference
    rates = reference.velocities or [0.0] * len(names)
    if not len(names) == len(reference.positions) == len(rates):
        return None
    if not all(map(math.isfinite, (*reference.positions, *rates))):
        return None
    motions = [
        short_motion(joints.get(name, SteeredJoint()), place, rate, velocities.get(name, 0.0), age)
        for name, place, rate in zip(names, reference.positions, rates, strict=True)
    ]
    message = JointTrajectory(joint_names=names)
    message.header.stamp = state.header.stamp
    message.points = [
        _point(age + STEP, [(motion.reached, motion.velocity) for motion in motions]),
        _point(age + 2 * STEP, [(motion.kept, motion.velocity) for motion in motions]),
        _point(age + 3 * STEP, [(motion.rest, 0.0) for motion in motions]),
    ]
    return message


def _point(time: float, states: Iterable[tuple[float, float]]) -> JointTrajectoryPoint:
    positions, velocities = zip(*states, strict=True)
    return JointTrajectoryPoint(
        positions=positions,
        velocities=velocities,
        time_from_start=Duration(seconds=time).to_msg(),
    )
