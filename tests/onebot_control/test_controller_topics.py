"""What topics, services and parameters of velocity_controller do, in step with a simulation."""

import math
import sys
import time
from collections.abc import Mapping
from types import FrameType
from typing import Any

import pytest
import rclpy
from geometry_msgs.msg import PoseStamped, Twist, TwistStamped
from nav_msgs.msg import Odometry
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import JointState
from std_msgs.msg import Bool, String
from std_srvs.srv import Trigger

from onebot_control import RobotSetup
from onebot_control.nodes import commands
from onebot_description.description import parse_description
from onebot_description.geometry.poses import Transform, compose
from onebot_description.ros.topic_qos import make_qos
from onebot_description.ros.wire.interfaces import TFMessage
from tests.onebot_control.arm_models import rod
from tests.onebot_control.control_support import CASTER, RADIUS, robot, urdf, wheel
from tests.onebot_control.node_support import NODE, RosSimulation, Stepped, twist, x
from tests.onebot_control.test_scene import BOX, WALL
from tests.ros_support import LATCHED, Peer
from tests.support import wait_for

ODOM, TRUTH, OUT = f"{NODE}/odom", f"{NODE}/ground_truth", f"{NODE}/cmd_vel_out"


def placed(x: float, frame: str = "") -> PoseStamped:
    """A pose that faces along x."""
    pose = PoseStamped()
    pose.header.frame_id, pose.pose.position.x, pose.pose.orientation.w = frame, x, 1.0
    return pose


def transform_of(pose: Any, position: str = "translation", rotation: str = "rotation") -> Transform:
    p, q = getattr(pose, position), getattr(pose, rotation)
    return (p.x, p.y, p.z), (q.x, q.y, q.z, q.w)


def by_child(messages: list[TFMessage]) -> Mapping[str, Any]:
    """The last transform of each frame."""
    return {each.child_frame_id: each for message in messages for each in message.transforms}


ROOMS = ("nodes", "runtime", "simulation_core", "fleet", "controlled_robot", "drive", "physics")


def test_a_twist_goes_down_and_back_once(ros_simulation: RosSimulation) -> None:
    """Each call is to a room below, but the one that publishes the state of a control cycle."""
    stepped = Stepped(ros_simulation(robot()))
    odom, calls = stepped.hear(Odometry, ODOM), set[tuple[int, int]]()

    def room(frame: FrameType | None) -> int:
        package, name, *_ = [*(frame.f_globals["__name__"].split(".") if frame else ()), "", ""]
        return ROOMS.index(name) if package == "onebot_control" and name in ROOMS else -1

    def follow(frame: FrameType, event: str, _: object) -> None:
        caller = frame.f_back
        while caller and room(caller) < 0:
            caller = caller.f_back
        if event == "call" and room(frame) >= 0:
            calls.add((room(caller), room(frame)))

    sys.setprofile(follow)
    try:
        stepped.drive(twist(0.3), 1.0)
    finally:
        sys.setprofile(None)
    assert x(odom[-1]) > 0.1 and {called for _, called in calls} == {*range(len(ROOMS))}
    upward = [(ROOMS[caller], ROOMS[called]) for caller, called in calls if called < caller]
    assert upward == [("simulation_core", "nodes")]


def test_a_lock_stops_the_robot_whoever_drives(
    ros_simulation: RosSimulation, capfd: pytest.CaptureFixture[str]
) -> None:
    """Locked, it brakes within its limits and ignores commands; unlocked, it waits for new ones.

    Its state is latched, and the log names the way to unlock it.
    """
    stepped = Stepped(ros_simulation(robot()))
    limited = stepped.hear(TwistStamped, OUT)

    def speeds() -> list[float]:
        return [message.twist.linear.x for message in limited]

    stepped.drive(twist(0.3), 1.0)
    assert speeds()[-1] == 0.3
    limited.clear()
    stepped.publish(f"{NODE}/cmd_vel_lock", Bool(data=True))
    stepped.drive(twist(0.3), 1.0)
    braking = [speed for speed in speeds() if speed]
    # By control.yaml's 0.5 m/s^2, to rest.
    assert braking == sorted(braking, reverse=True) and len(braking) == pytest.approx(60, abs=1)
    assert speeds()[-1] == 0.0
    state = stepped.hear(Bool, f"{NODE}/cmd_vel_locked", LATCHED)
    assert state == [Bool(data=True)]
    stepped.publish(f"{NODE}/cmd_vel_lock", Bool(data=False), apart=0.2)
    assert state[-1] == Bool(data=False) and speeds()[-1] == 0.0
    stepped.drive(twist(0.2), 0.5)
    assert speeds()[-1] == 0.2
    stepped.drive(twist(math.nan), 0.5)
    assert not any(map(math.isnan, speeds()))
    log = capfd.readouterr().err
    assert f"until false is published on {NODE}/cmd_vel_lock, or" in log
    assert log.count("~/cmd_vel is ignored: the robot is locked until") == 1
    assert log.count("~/cmd_vel is ignored: not finite: linear.x nan") == 1


def test_services_and_teleport(
    ros_simulation: RosSimulation, capfd: pytest.CaptureFixture[str]
) -> None:
    """Teleport, reset_odometry and reset do what they are called."""
    stepped = Stepped(ros_simulation(robot(), x=1.0, parameters={"world_frame_id": "world"}))
    odom, truth = stepped.hear(Odometry, ODOM), stepped.hear(Odometry, TRUTH)

    def at(wheels: float, true: float) -> bool:
        stepped.simulation.run(0.04)
        return (x(odom[-1]), x(truth[-1])) == pytest.approx((wheels, true), abs=1e-3)

    assert at(0.0, 1.0)
    stepped.publish(f"{NODE}/teleport", placed(7.0))
    assert at(0.0, 7.0)
    stepped.publish(f"{NODE}/teleport", placed(2.0, "odom"))
    assert at(0.0, 3.0)
    far, turned = placed(1.1e9), placed(1.0)
    turned.pose.orientation.w = 0.0
    for pose in (turned, far):
        stepped.publish(f"{NODE}/teleport", pose)
    assert "~/teleport is ignored: x 1 m, y 0 m, yaw nan rad must be" in capfd.readouterr().err
    assert stepped.call(Trigger, f"{NODE}/reset_odometry").success
    assert at(0.0, 3.0)
    assert stepped.call(Trigger, f"{NODE}/reset").success
    assert at(0.0, 1.0)


@pytest.mark.parametrize(("frame", "world"), [("", ""), ("map", "map")])
def test_a_standing_robot_is_teleported_to_a_pose_in_the_world(
    ros_simulation: RosSimulation, frame: str, world: str
) -> None:
    """Not relative to where it started; it has no odometry, so "" is no name of its frame."""
    stepped = Stepped(ros_simulation(rod(), x=1.0, parameters={"world_frame_id": world}))
    stepped.publish("controller_manager/teleport", placed(3.0, frame))
    assert stepped.simulation.robot.pose.x == pytest.approx(3.0)


def test_parameters_take_effect_or_are_refused(ros_simulation: RosSimulation) -> None:
    """A limit set while it drives counts at once; what cannot be set says why."""
    stepped = Stepped(ros_simulation(robot()))
    limited, odom = stepped.hear(TwistStamped, OUT), stepped.hear(Odometry, ODOM)

    def given(**values: Any) -> bool:
        return all(result.successful for result in stepped.set_parameters(NODE, **values))

    stepped.drive(twist(0.3), 1.0)
    assert limited[-1].twist.linear.x == 0.3
    assert given(**{"linear.x.max_velocity": 0.1, "odom_frame_id": "wheels"})
    stepped.drive(twist(0.3), 1.0)
    assert limited[-1].twist.linear.x == 0.1
    assert odom[-1].header.frame_id == "wheels"
    for name, value, reason in (
        ("wheel_radius", -1.0, "wheel_radius out of range"),
        ("update_rate", 50, "read-only parameter"),
        ("joint_state_broadcaster.joints", ["arm"], 'no joint "arm"'),
        ("odom_frame_id", "base_link", '"base_link" is base_frame_id; each frame needs a unique'),
    ):
        (result,) = stepped.set_parameters(NODE, **{name: value})
        assert not result.successful and reason in result.reason
    for wanted in (False, True):
        assert given(publish_limited_velocity=wanted)
        topics = {publisher.topic_name for publisher in stepped.ros._robot_nodes[0].publishers}
        assert (OUT in topics) == wanted
        limited.clear()
        stepped.simulation.run(0.1)
        assert len(limited) == (10 if wanted else 0)


def test_odometry_that_drifts_from_the_truth_is_warned_of_once(
    ros_simulation: RosSimulation, capfd: pytest.CaptureFixture[str]
) -> None:
    """Also if no node is in step."""
    ros = ros_simulation(robot(), parameters={"wheel_radius": 2.0 * RADIUS})
    ros.simulation.robot.drive(0.2)
    ros.simulation.run(10.0)
    assert capfd.readouterr().err.count("odometry and ground truth drift apart") == 1


def test_a_joint_that_mimics_a_wheel_is_in_joint_states_and_on_tf(
    ros_simulation: RosSimulation,
) -> None:
    """By its multiplier and offset, and clipped to its limit."""
    slide = (
        '<link name="slide"/><joint name="slide" type="prismatic"><parent link="base_link"/>'
        '<child link="slide"/><mimic joint="left_wheel_joint" multiplier="0.5" offset="0.1"/>'
        '<limit lower="-1" upper="0.3" effort="1" velocity="1"/></joint>'
    )
    description = parse_description(urdf(wheel("left", 0.2), wheel("right", -0.2), CASTER, slide))
    stepped = Stepped(ros_simulation(description))
    states, frames = stepped.hear(JointState, "/joint_states"), stepped.hear(TFMessage, "/tf")
    for velocity, seconds in ((0.02, 0.5), (0.2, 3.0)):
        stepped.drive(twist(velocity), seconds)
        positions = dict(zip(states[-1].name, states[-1].position, strict=True))
        expected = min(0.1 + 0.5 * positions["left_wheel_joint"], 0.3)
        [seen, *_] = [
            each.transform.translation.x
            for message in reversed(frames)
            for each in message.transforms
            if each.child_frame_id == "slide"
        ]
        assert positions["slide"] == pytest.approx(expected) == seen
    assert seen == 0.3


# Commands ---------------------------------------------------------------------------------------


def test_a_second_type_of_commands_is_warned_of(
    ros_simulation: RosSimulation, capfd: pytest.CaptureFixture[str]
) -> None:
    """The first one is followed as long as it is published."""
    stepped = Stepped(ros_simulation(robot()))
    stepped.client.create_publisher(Twist, f"{NODE}/cmd_vel", 10)
    with Peer(rclpy.get_default_context().get_domain_id(), "second") as second:
        second.node.create_publisher(TwistStamped, f"{NODE}/cmd_vel", 10)
        log = ""

        def warned() -> bool:
            nonlocal log
            stepped.simulation.run(0.3)
            log += capfd.readouterr().err
            return "TwistStamped, which is ignored: stop that publisher, or the" in log

        wait_for(warned, "the warning of the other type")


def test_commands_on_cmd_vel_are_reported_if_nobody_receives_them(
    ros_simulation: RosSimulation,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:
    """Once, with the topic that is meant; a node that relays them is enough."""
    monkeypatch.setattr(commands, "_SETTLED", 0.3)
    stepped = Stepped(ros_simulation(robot()))
    relay = stepped.client.create_subscription(Twist, "/cmd_vel", print, 10)
    stepped.client.create_publisher(Twist, "/cmd_vel", 10)
    [controller] = stepped.ros._robot_nodes

    def reports(relays: int) -> int:
        """How often it is reported within some looks, from when the relay is known or gone."""
        ends = controller.count_publishers, controller.count_subscribers
        wait_for(lambda: [end("/cmd_vel") for end in ends] == [1, relays], "discovery")
        for _ in range(4):
            time.sleep(0.15)
            stepped.simulation.run(0.3)
        text = "/cmd_vel is published, but no node subscribes to it: the topic of this robot's"
        return capfd.readouterr().err.count(f"{text} commands is {NODE}/cmd_vel")

    assert reports(1) == 0
    stepped.client.destroy_subscription(relay)
    assert reports(0) == 1


# Worlds -----------------------------------------------------------------------------------------


def test_a_robot_in_a_world(
    ros_simulation: RosSimulation, capfd: pytest.CaptureFixture[str]
) -> None:
    """It pushes the box to the wall: TF has both where they are, while the odometry goes on."""
    links = f'<link name="floor"/>{WALL.replace("0.65 0 0.2", "1.5 0 0.2")}{BOX}'
    text = f'<robot name="w">{links}</robot>'.replace('"world"', '"floor"')
    around = parse_description(text, "w.urdf")
    stepped = Stepped(ros_simulation(robot(), world=around, x=-0.5))
    described = stepped.hear(String, "/world_description", LATCHED)
    tf, truth = stepped.hear(TFMessage, "/tf"), stepped.hear(Odometry, TRUTH)
    stepped.simulation.run(0.04)
    # By the world and by robot_state_publisher: a queue of one keeps only one of them.
    qos = make_qos(100, reliable=True, latched=True)
    static = stepped.hear(TFMessage, "/tf_static", qos)
    assert described[0].data == around.urdf
    still = by_child(static)
    assert {name: each.header.frame_id for name, each in still.items()} == {
        "floor": "world",
        "wall": "floor",
        "caster": "base_link",
    }
    assert transform_of(still["wall"].transform)[0] == (1.5, 0.0, 0.2)
    assert truth[-1].header.frame_id == by_child(tf)["box"].header.frame_id == "world"
    assert x(truth[-1]) == pytest.approx(-0.5)
    for name, value, reason in (
        ("world_frame_id", "map", 'are in "world"; restart the node'),
        ("odom_frame_id", "wall", '"wall" is a link of the world'),
    ):
        (refused,) = stepped.set_parameters(NODE, **{name: value})
        assert not refused.successful and reason in refused.reason

    simulated = stepped.simulation.robot
    simulated.drive(0.6)
    stepped.simulation.run(until=lambda: simulated.odometry.x > simulated.pose.x + 0.8)
    stepped.simulation.run(0.1)
    frames = {name: transform_of(each.transform) for name, each in by_child(tf).items()}
    assert frames["box"][0][0] == pytest.approx(1.3, abs=0.07)
    place, turn = compose(frames["odom"], frames["base_link"])
    true = transform_of(truth[-1].pose.pose, "position", "orientation")
    assert place == pytest.approx(true[0], abs=1e-9)
    assert turn == pytest.approx(true[1], abs=1e-9)
    simulated.drive(0.0)
    stepped.publish(f"{NODE}/teleport", placed(1.5))
    assert "~/teleport is ignored: x 1.5 m" in capfd.readouterr().err
    assert stepped.call(Trigger, f"{NODE}/reset").success
    stepped.simulation.run(0.1)
    box = transform_of(by_child(tf)["box"].transform)
    assert box[0] == pytest.approx((0.5, 0.0, 0.1), abs=0.01)


# Several robots ---------------------------------------------------------------------------------


def test_robots_of_one_world(ros_simulation: RosSimulation) -> None:
    """Each has topics and frames of its own; b drives against a, and c turns elsewhere."""
    starts = {"a": (0.0, 0.0), "b": (-0.8, 0.0), "c": (0.0, 3.0)}
    setups = {name: RobotSetup(*place) for name, place in starts.items()}
    parameters = {"world_frame_id": "world", "cmd_vel_timeout": 2.0}
    stepped = Stepped(ros_simulation(robot(), robots=setups, parameters=parameters))
    joints = {name: stepped.hear(JointState, f"/{name}/joint_states") for name in starts}
    odom = {name: stepped.hear(Odometry, f"/{name}{ODOM}") for name in starts}
    truth = {name: stepped.hear(Odometry, f"/{name}{TRUTH}") for name in starts}
    every = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    tf, static = stepped.hear(TFMessage, "/tf"), stepped.hear(TFMessage, "/tf_static", every)
    stepped.simulation.run(0.04)
    for name, (place_x, place_y) in starts.items():
        position = truth[name][-1].pose.pose.position
        assert (position.x, position.y) == pytest.approx((place_x, place_y), abs=1e-3)
        assert len(joints[name]) == 4
    # The links of the robots are published, too, as somebody listens to TF.
    wheels = [("{}/base_link", f"{{}}/{side}_wheel") for side in ("left", "right")]
    caster = ("{}/base_link", "{}/caster")
    for messages, expected in (
        (tf, [("{}/odom", "{}/base_link"), *wheels]),
        (static, [("world", "{}/odom"), caster]),
    ):
        frames = {(t.header.frame_id, t.child_frame_id) for m in messages for t in m.transforms}
        assert frames == {
            (parent.format(name), child.format(name))
            for name in starts
            for parent, child in expected
        }
    assert stepped.client.count_publishers("/clock") == 1
    stepped.publish(f"/c{NODE}/cmd_vel", twist(0.0, 1.0))
    stepped.drive(twist(0.3), 4.0, f"/b{NODE}")
    assert x(odom["b"][-1]) > 0.9  # as its wheels have it
    assert x(truth["b"][-1]) == pytest.approx(-0.12, abs=0.02)  # a is in its way
    assert x(truth["a"][-1]) == pytest.approx(0.0, abs=0.02)
    assert odom["c"][-1].pose.pose.orientation.z > 0.3
    assert x(truth["c"][-1]) == pytest.approx(0.0, abs=0.05)
    assert stepped.call(Trigger, f"/b{NODE}/reset").success
    stepped.simulation.run(0.04)
    assert x(truth["b"][-1]) == pytest.approx(-0.8, abs=1e-3)
    assert stepped.set_parameters(f"/b{NODE}", real_time_factor=2.0)[0].successful
    nodes = [node for node in stepped.ros._robot_nodes if node.has_parameter("real_time_factor")]
    factors = [node.get_parameter("real_time_factor").value for node in nodes]
    assert factors == [2.0] * 3
