"""Publishes the topics of velocity_controller, and ``/clock``, in each control cycle.

The messages are created once and filled again in each cycle, because rclpy has read them when
``publish`` returns.
"""

from collections import deque
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from builtin_interfaces.msg import Time
from geometry_msgs.msg import Pose, TransformStamped, TwistStamped
from geometry_msgs.msg import Transform as TransformMessage
from geometry_msgs.msg import Twist as TwistMessage
from nav_msgs.msg import Odometry
from rclpy.node import Node
from rclpy.publisher import Publisher
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from onebot_control.controlled_robot import ControlledRobot, Snapshot
from onebot_control.drive.drive import Drive, DriveState
from onebot_control.drive.mecanum import MecanumParameters
from onebot_control.drive.steered import SteeringControllerParameters
from onebot_control.drive.wheels.rollers import MecanumWheels
from onebot_control.physics.robot_body import JointStates, Twist
from onebot_control.physics.scene import SceneBodies, scene_frames
from onebot_control.runtime.frames import RobotFrames
from onebot_control.runtime.pacing import Divider
from onebot_description.geometry.poses import Transform, compose, inverse
from onebot_description.ros.node_graph import OnlyPublisher
from onebot_description.ros.topic_qos import DEPTH, LATCHED
from onebot_description.ros.wire.interfaces import TFMessage, load_interface
from onebot_description.ros.wire.messages import fill_diagonal, time_message, transforms_message
from onebot_description.timing import NS_PER_S

_KEPT = 200  # number of published true transforms that are remembered
_TWO_CLOCKS = (
    "time jumps between two simulations. Separate them with domain_id:=N, or start one of them in "
    "real time without /clock: use_sim_time:=false and real_time_factor 1.0"
)

States = Mapping[str, Sequence[float]]
"""The position, velocity and effort of each joint, by name."""


class Publishers:
    """Publishes a robot's snapshots. Only used by the control thread.

    Attributes:
        world_frame: frame of true poses; "" for none.
        odom_frame: frame of the odometry.
        localized: whether another node has published a parent of odom, which replaces ground truth.
        truths: parents, stamps in ns and poses of odom that were published recently.
    """

    def __init__(self, node: Node, *, clock: bool, odometry: str | None = "odom") -> None:
        """Create the publishers.

        Args:
            node: node of the robot.
            clock: whether to also publish /clock.
            odometry: name of the odometry topic, in the node's namespace; None if the robot has no
                drive.
        """
        self._node = node
        self._joint_states = node.create_publisher(JointState, "joint_states", DEPTH)
        self._tf_static = node.create_publisher(TFMessage, "/tf_static", LATCHED)
        if odometry is not None:
            self._odom = node.create_publisher(Odometry, f"~/{odometry}", DEPTH)
            self._truth = node.create_publisher(Odometry, "~/ground_truth", DEPTH)
            self._tf = node.create_publisher(TFMessage, "/tf", DEPTH)
        self.localized = False
        self.truths: deque[tuple[str, int, Transform]] = deque(maxlen=_KEPT)
        # The last published static ground truth.
        self._origin: tuple[str, str, Transform] | None = None
        self._limited: Publisher | None = None
        self._states: Publisher | None = None  # ~/controller_state
        self._clock: Publisher | None = None
        if clock:
            self._clock = node.create_publisher(Clock, "/clock", DEPTH)
            OnlyPublisher(node, "/clock", _TWO_CLOCKS, own=True)

    def use(self, robot: ControlledRobot, frames: RobotFrames) -> None:
        """Publish this robot from now on, with its current parameters and ``frames``."""
        self._robot, config = robot, robot.config
        drive = config.drive
        self._in_scene = robot.body.world.scene is not None  # there, odom drifts
        self.world_frame, odom, base, _ = frames
        self.odom_frame = odom
        self.localized = self.localized and config.ground_truth_tf
        self._stamp = Time()  # shared by all messages of a cycle
        self._clock_message = Clock(clock=self._stamp)
        self._odom_message = self._odometry(odom, base)
        if drive is not None:
            state = next((row for kind, row in _STATES.items() if isinstance(drive, kind)), None)
            if state and self._states is None:
                kind, self._fill_state = load_interface(state[0]), state[1]
                self._states = self._node.create_publisher(kind, "~/controller_state", DEPTH)
            self._odom_tf = drive.enable_odom_tf
            self._constant = any(drive.pose_covariance_diagonal)
            fill_diagonal(self._odom_message.pose.covariance, drive.pose_covariance_diagonal)
            fill_diagonal(self._odom_message.twist.covariance, drive.twist_covariance_diagonal)
        self._truth_message = self._odometry(self.world_frame or odom, base)
        self._transform = TransformStamped(child_frame_id=base)
        self._tf_message = TFMessage(transforms=[self._transform])
        self._placed_frame = odom or base  # child of world_frame
        self._origin_transform = TransformStamped(child_frame_id=self._placed_frame)
        self._origin_message = TFMessage(transforms=[self._origin_transform])
        self._limited_message = TwistStamped()
        self._joint_message = JointState(name=robot.broadcaster.names)
        for message, frame in (
            (self._transform, odom),
            (self._origin_transform, self.world_frame),
            (self._limited_message, base),
            (self._joint_message, robot.broadcaster.frame_id),
        ):
            message.header.frame_id, message.header.stamp = frame, self._stamp
        limited = drive is not None and drive.publish_limited_velocity
        if limited and self._limited is None:
            self._limited = self._node.create_publisher(TwistStamped, "~/cmd_vel_out", DEPTH)
        elif not limited and self._limited is not None:
            self._node.destroy_publisher(self._limited)
            self._limited = None
        self._due = Divider(config.publish_rate, config.update_rate)

    @property
    def publishes_truth(self) -> bool:
        """Whether ground truth is on TF."""
        if self.localized or not self.world_frame:
            return False
        return self._robot.config.ground_truth_tf

    def give_way(self, source: str) -> None:
        """Remove ground truth from TF, as another node publishes ``source``, a parent of odom."""
        self.localized = True
        text = f"another node publishes {source} on TF, so {self.world_frame} -> {self.odom_frame}"
        text += " is no longer published; to publish it again, restart, or set ground_truth_tf"
        self._node.get_logger().info(f"{text} to false and then to true")

    def _odometry(self, frame: str, child: str) -> Odometry:
        message = Odometry(child_frame_id=child)
        message.header.frame_id, message.header.stamp = frame, self._stamp
        return message

    def publish(self, snapshot: Snapshot, stamp_ns: int, *, sensed: bool = False) -> None:
        """Publish everything that is due.

        Args:
            snapshot: state of the robot.
            stamp_ns: stamp of the cycle, ns.
            sensed: whether a sensor measures in this cycle, and needs transforms of this time.
        """
        robot = self._robot
        self._stamp.sec, self._stamp.nanosec = divmod(stamp_ns, NS_PER_S)
        if self._clock is not None:
            self._clock.publish(self._clock_message)
        if _is_subscribed(self._joint_states):
            joints, values = self._joint_message, robot.broadcaster.values(snapshot.joint_states)
            joints.position, joints.velocity, joints.effort = values
            self._joint_states.publish(joints)
        if snapshot.drive is not None:
            self._publish_drive(snapshot, snapshot.drive, stamp_ns, sensed=sensed)
            if self._states is not None and _is_subscribed(self._states):
                self._publish_state(self._states, snapshot.joint_states)
        if snapshot.drive is None or not self._in_scene:
            self._publish_origin(snapshot, stamp_ns)

    def _publish_state(self, publisher: Publisher, states: JointStates) -> None:
        """Publish the state of the drive, like its standard controller."""
        drive, message = self._robot.drive, publisher.msg_type()
        assert drive is not None
        message.header.stamp = self._stamp
        message.header.frame_id = drive.config.base_frame_id or drive.wheels.description.root_link
        rows = zip(*states, strict=True)
        self._fill_state(message, drive, dict(zip(self._robot.joints, rows, strict=True)))
        publisher.publish(message)

    def _publish_drive(
        self, snapshot: Snapshot, drive: DriveState, stamp_ns: int, *, sensed: bool
    ) -> None:
        if self._limited is not None and _is_subscribed(self._limited):
            _fill_planar(self._limited_message.twist, *drive.command[:3])
            self._limited.publish(self._limited_message)
        due = self._due.due()
        if due or sensed:
            pose = drive.odometry.transform
            if self._odom_tf and _is_subscribed(self._tf):
                _fill_transform(self._transform.transform, pose)
                self._tf.publish(self._tf_message)
            if self._in_scene and self.publishes_truth:
                self._publish_true_origin(snapshot, pose, stamp_ns)
        if due:
            self._publish_odometry(drive, pose)
            if _is_subscribed(self._truth):
                self._publish_ground_truth(snapshot, drive)

    def _publish_odometry(self, drive: DriveState, pose: Transform) -> None:
        if not _is_subscribed(self._odom):
            return
        _fill_pose(self._odom_message.pose.pose, pose)
        if not self._constant:
            drive.covariance.fill(self._odom_message.pose.covariance)
        _fill_planar(self._odom_message.twist.twist, *drive.twist)
        self._odom.publish(self._odom_message)

    def _publish_ground_truth(self, snapshot: Snapshot, drive: DriveState) -> None:
        truth: Transform = snapshot.pose
        if not self.world_frame:
            truth = compose(drive.origin.inverse().transform, truth)
        _fill_pose(self._truth_message.pose.pose, truth)
        _fill_twist(self._truth_message.twist.twist, snapshot.velocity)
        self._truth.publish(self._truth_message)

    def _publish_origin(self, snapshot: Snapshot, stamp_ns: int) -> None:
        """Publish the static pose of odom, or of a fixed base, in the world.

        It is only published when it changes. To withdraw it, a message without transforms replaces
        the last one for late subscribers.
        """
        origin: tuple[str, str, Transform] | None = None
        if self._placed_frame and self.publishes_truth:
            pose = snapshot.drive.origin.transform if snapshot.drive else snapshot.pose
            origin = self.world_frame, self._placed_frame, pose
        if origin == self._origin:
            return
        self._origin = origin
        if origin is None:
            self._tf_static.publish(TFMessage())
        else:
            self._fill_origin(pose, stamp_ns)
            self._tf_static.publish(self._origin_message)

    def _publish_true_origin(self, snapshot: Snapshot, odometry: Transform, stamp_ns: int) -> None:
        """Publish the pose of odom in the world that places the robot at its true pose.

        Wheels slip at a wall, and a ramp tilts the robot; odometry contains neither.
        """
        self._fill_origin(compose(snapshot.pose, inverse(odometry)), stamp_ns)
        if _is_subscribed(self._tf):
            self._tf.publish(self._origin_message)

    def _fill_origin(self, pose: Transform, stamp_ns: int) -> None:
        _fill_transform(self._origin_transform.transform, pose)
        self.truths.append((self.world_frame, stamp_ns, pose))


def _fill_mecanum(message: Any, drive: Drive, states: States) -> None:
    """Write the measured velocity of the first wheel at each corner, and the limited command."""
    wheels = drive.wheels
    assert isinstance(wheels, MecanumWheels)
    corners = "front_left", "front_right", "back_right", "back_left"
    for corner, [name, *_] in zip(corners, wheels.corners, strict=True):
        _, velocity, _ = states[name]
        setattr(message, f"{corner}_wheel_velocity", wheels.directions[name] * velocity)
    _fill_planar(message.reference_velocity, *drive.command[:3])


def _fill_steering(message: Any, drive: Drive, states: States) -> None:
    """Write the measured states and the commands of the wheels and the steering."""
    wheels = drive.wheels
    traction = [(states[name], wheels.directions[name]) for name in wheels.names]
    message.traction_wheels_position = [sign * position for (position, *_), sign in traction]
    message.traction_wheels_velocity = [sign * velocity for (_, velocity, _), sign in traction]
    message.steer_positions = [states[name][0] for name in wheels.steering]
    message.linear_velocity_command = [*drive.command.wheels]
    message.steering_angle_command = drive.steering


_STATES: Mapping[type, tuple[str, Callable[[Any, Drive, States], None]]] = {
    MecanumParameters: ("control_msgs/msg/MecanumDriveControllerState", _fill_mecanum),
    SteeringControllerParameters: ("control_msgs/msg/SteeringControllerStatus", _fill_steering),
}


def _is_subscribed(publisher: Publisher) -> bool:
    """Return whether there are subscribers; publishing is much slower than this check."""
    return bool(publisher.get_subscription_count())


class ScenePublisher:
    """Publishes the scene around the robots of a world, once for all robots.

    The frames are named after the links; the root link may be the world frame itself.
    """

    def __init__(self, node: Node, scene: SceneBodies, world_frame: str, rate: Divider) -> None:
        """Create the publishers, and publish the description.

        Args:
            node: the publisher.
            scene: the bodies of the scene; only names and description are kept.
            world_frame: parent of all frames.
            rate: selects the cycles in which /tf is due.
        """
        self._scene, self._world, self._rate = scene.description, world_frame, rate
        self._tf = node.create_publisher(TFMessage, "/tf", DEPTH)
        self._tf_static = node.create_publisher(TFMessage, "/tf_static", LATCHED)
        self._description = node.create_publisher(String, "/world_description", LATCHED)
        self._description.publish(String(data=scene.description.urdf))
        self._stamp = Time()
        self._transforms = [TransformStamped(child_frame_id=link) for link in scene.links]
        for transform in self._transforms:
            transform.header.frame_id, transform.header.stamp = world_frame, self._stamp
        self._message = TFMessage(transforms=self._transforms)
        self._announced = False

    def publish(self, stamp_ns: int, poses: Sequence[Transform]) -> None:
        """Publish the poses if they are due; call it in each control cycle.

        Args:
            stamp_ns: stamp of the cycle, ns.
            poses: poses of the movable bodies in the world.
        """
        if not self._announced:
            self._announced = True
            frames = scene_frames(self._scene, self._world)
            self._tf_static.publish(transforms_message(time_message(stamp_ns), *frames))
        if not self._rate.due() or not self._transforms or not _is_subscribed(self._tf):
            return
        self._stamp.sec, self._stamp.nanosec = divmod(stamp_ns, NS_PER_S)
        for transform, pose in zip(self._transforms, poses, strict=True):
            _fill_transform(transform.transform, pose)
        self._tf.publish(self._message)


def _fill_transform(message: TransformMessage, pose: Transform) -> None:
    shift, turn = message.translation, message.rotation
    (shift.x, shift.y, shift.z), (turn.x, turn.y, turn.z, turn.w) = pose


def _fill_pose(message: Pose, pose: Transform) -> None:
    place, turn = message.position, message.orientation
    (place.x, place.y, place.z), (turn.x, turn.y, turn.z, turn.w) = pose


def _fill_twist(message: TwistMessage, twist: Twist) -> None:
    linear, angular = message.linear, message.angular
    linear.x, linear.y, linear.z = twist.linear
    angular.x, angular.y, angular.z = twist.angular


def _fill_planar(message: TwistMessage, linear: float, lateral: float, angular: float) -> None:
    """Write a planar twist; the other components stay zero."""
    message.linear.x, message.linear.y, message.angular.z = linear, lateral, angular
