"""The navigator beside a simulated robot, by Nav2's interfaces, as clients of Nav2 use them."""

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from geometry_msgs.msg import Point, PoseStamped, PoseWithCovarianceStamped, TransformStamped, Twist
from nav2_msgs.action import (
    BackUp,
    ComputePathThroughPoses,
    ComputePathToPose,
    DriveOnHeading,
    FollowPath,
    FollowWaypoints,
    NavigateThroughPoses,
    NavigateToPose,
    SmoothPath,
    Spin,
    Wait,
)
from nav2_msgs.srv import ClearCostmapAroundRobot, LoadMap, ManageLifecycleNodes, SaveMap
from nav_msgs.msg import OccupancyGrid, Odometry
from rcl_interfaces.srv import SetParameters
from rclpy.action import ActionClient
from rclpy.duration import Duration
from rclpy.parameter import Parameter
from sensor_msgs.msg import LaserScan
from std_msgs.msg import Bool, String
from tf2_msgs.msg import TFMessage

from onebot_bringup.cli.main import main as onebot
from onebot_control.drive.controller_limits import ControllerLimits
from onebot_control.drive.speed_limiter import SpeedLimits
from onebot_control.navigation.footprint import vehicle_of
from onebot_control.navigation.map_files import load_map
from onebot_control.nodes.navigation.lifecycle import offer_lifecycle
from onebot_control.nodes.navigation.maps import costs_as_occupancy
from onebot_control.nodes.navigation.measurements import scan_of
from onebot_control.occupancy_grid import OccupancyGrid as Grid
from onebot_description.description import load_description
from onebot_description.geometry import matrices
from onebot_description.ros.domains import used_domain
from tests.ros_support import LATCHED, NodeProcess, Peer, node_here, spin_until
from tests.support import PATIENCE, wait_for

BRINGUP = "onebot_bringup.launch.onebot_bringup"
SUCCEEDED, CANCELED, ABORTED = 4, 5, 6
slow = pytest.mark.slow


# Conversions ------------------------------------------------------------------------------------


def _scan(least: float, step: float) -> LaserScan:
    ranges = [0.05, 1.0, 2.0, math.inf]
    return LaserScan(
        angle_min=least, angle_increment=step, ranges=ranges, range_min=0.1, range_max=5.0
    )


@pytest.mark.parametrize(
    ("least", "step", "roll"), [(-0.1, 0.1, 0.0), (0.1, -0.1, math.pi), (0.2, -0.1, 0.0)]
)
def test_points_of_a_scan_are_where_the_lidar_sees_them(
    least: float, step: float, roll: float
) -> None:
    """Upright, hanging, and counting to the right."""
    mount = matrices.of_transform(
        ((0.3, 0.1, 0.2), (math.sin(roll / 2), 0.0, 0.0, math.cos(roll / 2)))
    )
    scan = scan_of(_scan(least, step), mount)
    assert scan.step > 0.0 and np.isneginf(scan.ranges).sum() == np.isposinf(scan.ranges).sum() == 1
    expected = []
    for row, distance in ((1, 1.0), (2, 2.0)):
        angle = least + row * step
        seen = mount @ (distance * math.cos(angle), distance * math.sin(angle), 0.0, 1.0)
        expected.append(seen[:2])
    found = scan.points[np.argsort(np.hypot(*(scan.points - (0.3, 0.1)).T))]
    assert found == pytest.approx(np.array(expected), abs=1e-6)


def test_costs_are_published_as_nav2_does() -> None:
    costs = np.array([[0, 1, 126, 252, 253, 254, 255]], np.uint8)
    published = costs_as_occupancy(Grid(costs.view(np.int8), 0.05, (0.0, 0.0))).data
    assert published.tolist() == [[0, 1, 49, 98, 99, 100, -1]]


def test_parameters_are_set_by_the_name_of_nav2s_node(ros_domain: int) -> None:
    """An unknown one is refused; it ends neither the request nor the node."""
    with node_here("navigator") as node:
        node.declare_parameter("stop_on_failure", True)
        offer_lifecycle(node, lambda: True)
        client = node.create_client(SetParameters, "waypoint_follower/set_parameters")
        values = Parameter("unknown", value=1), Parameter("stop_on_failure", value=False)
        request = SetParameters.Request(parameters=[each.to_parameter_msg() for each in values])
        answer = client.call_async(request)
        spin_until(node, answer.done, "an answer")
        assert [each.successful for each in answer.result().results] == [False, True]
        assert node.get_parameter("stop_on_failure").value is False


def test_the_strictest_limits_count() -> None:
    onebot_urdf = load_description("package://onebot_description/urdf/onebot.urdf.xacro")
    fast = ControllerLimits(
        "/a", SpeedLimits(max_velocity=2.0, max_acceleration=9.0), SpeedLimits()
    )
    slow = ControllerLimits(
        "/b",
        SpeedLimits(max_velocity=0.4, min_velocity=-0.1),
        SpeedLimits(max_velocity=1.0),
        minimum_radius=0.5,
    )
    both = vehicle_of(onebot_urdf, [fast, slow])
    assert (both.forward, both.backward, both.acceleration) == (0.4, 0.1, 9.0)
    assert (both.sideways, both.turning, both.minimum_radius) == (0.0, 1.0, 0.5)
    unknown = vehicle_of(onebot_urdf, [])
    assert (unknown.forward, unknown.turning) == (0.5, 1.5)


def pose(x: float, y: float, yaw: float = 0.0, frame: str = "map") -> PoseStamped:
    message = PoseStamped()
    message.header.frame_id = frame
    message.pose.position.x, message.pose.position.y = x, y
    message.pose.orientation.z, message.pose.orientation.w = math.sin(yaw / 2), math.cos(yaw / 2)
    return message


# A robot whose sensors fail -----------------------------------------------------------------------


class Senses:
    """What a robot that stands in the middle of a round room measures."""

    def __init__(self, peer: Peer) -> None:
        self.peer = peer
        peer.node.declare_parameter("linear.x.max_velocity", 0.5)
        self.commands = peer.hear(Twist, "velocity_controller/cmd_vel")
        self.status = peer.hear(String, "navigator/status", LATCHED)
        self.poses = peer.hear(PoseWithCovarianceStamped, "amcl_pose", LATCHED)
        self._odometry = peer.publisher(Odometry, "velocity_controller/odom")
        self._scan = peer.publisher(LaserScan, "scan")
        static = TransformStamped(child_frame_id="lidar")
        static.header.frame_id, static.transform.rotation.w = "base_link", 1.0
        peer.publisher(TFMessage, "/tf_static", LATCHED).publish(TFMessage(transforms=[static]))

    def measure(self, frame: str = "lidar", late: float = 0.0, x: float = 0.0, **scan: Any) -> None:
        """Publish odometry and a scan, which is wrong in some way."""
        now = self.peer.node.get_clock().now()
        odometry = Odometry(child_frame_id="base_link")
        odometry.header.frame_id, odometry.header.stamp = "odom", now.to_msg()
        odometry.pose.pose.position.x, odometry.pose.pose.orientation.w = x, 1.0
        self._odometry.publish(odometry)
        whole = {"angle_min": -3.0, "angle_increment": 0.1, "ranges": [2.0] * 61}
        message = LaserScan(range_min=0.1, range_max=9.0, **{**whole, **scan})
        message.header.frame_id = frame
        message.header.stamp = (now - Duration(seconds=late)).to_msg()
        self._scan.publish(message)

    def measures(self, status: str, **wrong: Any) -> None:
        """Measure until the navigator has this status."""

        def has_it() -> bool:
            self.measure(**wrong)
            return bool(self.status) and self.status[-1].data.startswith(status)

        wait_for(has_it, status)


@pytest.fixture(scope="module")
def senses() -> Iterator[Senses]:
    robot = "package://onebot_description/urdf/onebot.urdf.xacro"
    with used_domain() as domain, Peer(domain) as peer:
        with NodeProcess("onebot_control.navigator", robot, check=False):
            senses = Senses(peer)
            senses.measures("idle")
            yield senses


@slow
@pytest.mark.parametrize(
    "wrong",
    [
        {"ranges": [math.nan] * 61},
        {"ranges": []},
        {"ranges": [0.0] * 61},
        {"angle_increment": 1e-30},
        {"angle_min": math.nan},
        {"angle_increment": 0.0},
        {"frame": "nowhere"},
        {"late": 1.0},
    ],
)
def test_it_stands_while_scans_are_wrong_and_goes_on(senses: Senses, wrong: dict[str, Any]) -> None:
    senses.peer.publisher(PoseStamped, "goal_pose").publish(pose(1.0, 0.0))
    senses.measures("driving")
    senses.measures("blocked: no scan of the last 0.3 s", **wrong)
    wait_for(lambda: senses.measure(**wrong) or senses.commands[-1].linear.x == 0.0, "a stop")
    senses.measures("driving")


@slow
def test_it_stands_while_nothing_is_measured_and_goes_on(senses: Senses) -> None:
    senses.peer.publisher(PoseStamped, "goal_pose").publish(pose(1.0, 0.0))
    senses.measures("driving")
    wait_for(lambda: senses.status[-1].data.startswith("blocked"), "the navigator to notice")
    wait_for(lambda: senses.commands[-1].linear.x == 0.0, "a stop")
    senses.measures("driving")


@slow
def test_a_stop_of_another_node_ends_a_goal_that_stands_too(senses: Senses) -> None:
    """It is not taken for one of the navigator's own commands, which are zero as well."""
    senses.peer.publisher(PoseStamped, "goal_pose").publish(pose(1.0, 0.0))
    senses.measures("driving")
    senses.measures("blocked", ranges=[math.nan] * 61)
    senses.peer.publisher(Twist, "velocity_controller/cmd_vel", subscribers=2).publish(Twist())
    senses.measures("cancelled: another node drives the robot", ranges=[math.nan] * 61)


@slow
def test_odometry_that_jumps_and_places_that_are_nowhere_move_nothing(senses: Senses) -> None:
    senses.peer.publisher(PoseStamped, "goal_pose").publish(pose(1.0, 0.0))
    senses.measures("driving")
    heard = len(senses.poses)
    wait_for(lambda: senses.measure(x=5.0) or len(senses.poses) > heard + 1, "a pose")
    assert senses.poses[-1].pose.pose.position.x == pytest.approx(0.0, abs=0.05)
    assert any("the odometry has jumped by 5.00 m" in each.data for each in senses.status)
    initial = senses.peer.publisher(PoseWithCovarianceStamped, "initialpose")
    for x, variance in ((1e9, 0.01), (0.0, -1.0), (0.0, 0.01)):
        estimate = PoseWithCovarianceStamped()
        estimate.pose.pose.position.x, estimate.pose.pose.orientation.w = x, 1.0
        estimate.pose.covariance[::7] = np.full(6, variance)
        initial.publish(estimate)
        more = len(senses.poses) + 2
        wait_for(lambda more=more: senses.measure(x=5.0) or len(senses.poses) > more, "poses")
    senses.peer.publisher(PoseStamped, "goal_pose").publish(pose(1.0, 0.0))
    senses.measures("driving", x=5.0)


# A robot in the maze ----------------------------------------------------------------------------


class Client:
    """A client of Nav2's actions."""

    def __init__(self, peer: Peer) -> None:
        self.peer = peer
        self.truth = peer.hear(Odometry, "velocity_controller/ground_truth")
        self.status = peer.hear(String, "navigator/status", LATCHED)

    def send(self, name: str, kind: Any, **goal: Any) -> Any:
        """Send a goal; the handle, the feedback and the future result; None if it is rejected."""
        client, feedback = ActionClient(self.peer.node, kind, name), list[Any]()
        assert client.wait_for_server(PATIENCE), name
        sent = self.peer.run(
            lambda: client.send_goal_async(kind.Goal(**goal), lambda m: feedback.append(m.feedback))
        )
        handle = wait_for(lambda: sent.done() and sent.result(), f"{name} to answer")
        if not handle.accepted:
            return None
        return handle, feedback, self.peer.run(handle.get_result_async)

    def do(self, name: str, kind: Any, **goal: Any) -> tuple[int, Any, list[Any]]:
        """The status, the result and the feedback of a goal that is accepted."""
        _, feedback, ended = self.send(name, kind, **goal)
        answer = wait_for(lambda: ended.done() and ended.result(), f"the end of {name}")
        return answer.status, answer.result, feedback

    @property
    def place(self) -> tuple[float, float]:
        """Where the robot is, once the messages in the queue of 10 have passed."""
        heard = len(self.truth)
        wait_for(lambda: len(self.truth) > heard + 10, "where the robot is")
        position = self.truth[-1].pose.pose.position
        return position.x, position.y

    @property
    def stands(self) -> bool:
        """Whether the robot has come to rest."""
        twist = self.truth[-1].twist.twist
        return abs(twist.linear.x) < 1e-3 and abs(twist.angular.z) < 1e-3


@pytest.fixture(scope="module")
def client() -> Iterator[Client]:
    words = "world:=maze", "y:=0.8", "sensors_enabled:=true", "navigate:=true", "viewer:=none"
    with used_domain() as domain, Peer(domain) as peer, NodeProcess(BRINGUP, *words):
        client = Client(peer)
        poses = peer.hear(PoseWithCovarianceStamped, "amcl_pose", LATCHED)
        wait_for(lambda: poses and client.truth, "the navigator")
        yield client


@slow
def test_it_drives_to_a_pose(client: Client) -> None:
    status, result, feedback = client.do(
        "navigate_to_pose", NavigateToPose, pose=pose(1.2, 0.8, 1.0)
    )
    assert (status, result.error_code) == (SUCCEEDED, 0)
    assert math.dist(client.place, (1.2, 0.8)) < 0.07
    # The first may come before the first plan.
    assert max(each.distance_remaining for each in feedback) > feedback[-1].distance_remaining
    assert client.status[-1].data == "arrived"


@slow
def test_goals_of_the_topic_and_by_poses(client: Client) -> None:
    client.peer.publisher(PoseStamped, "goal_pose").publish(pose(0.2, 0.0, frame="base_link"))
    wait_for(lambda: client.status[-1].data.startswith("driving"), "it to drive")
    wait_for(lambda: client.status[-1].data == "arrived", "its end")
    poses = [pose(0.9, 0.8), pose(0.4, 0.8), pose(0.0, 0.8)]
    status, _, feedback = client.do("navigate_through_poses", NavigateThroughPoses, poses=poses)
    assert status == SUCCEEDED and feedback[-1].number_of_poses_remaining == 1
    assert math.dist(client.place, (0.0, 0.8)) < 0.07
    poses = [pose(0.4, 0.8), pose(0.4, 1.2), pose(0.1, 0.8)]  # the second one is in a wall
    status, result, _ = client.do("follow_waypoints", FollowWaypoints, poses=poses)
    [missed] = result.missed_waypoints
    assert status == SUCCEEDED
    assert (missed.index, missed.error_code) == (1, ComputePathToPose.Result.GOAL_OCCUPIED)


@slow
def test_motions_and_plans(client: Client) -> None:
    status, _, feedback = client.do("spin", Spin, target_yaw=1.0)
    assert status == SUCCEEDED and feedback[-1].angular_distance_traveled == pytest.approx(
        1.0,
        abs=0.3,  # on a busy computer, it stops late
    )
    client.do("spin", Spin, target_yaw=-1.0)
    before = client.place
    goal: Any = DriveOnHeading.Goal(speed=0.3)
    goal.target.x = 0.4
    assert (
        client.do("drive_on_heading", DriveOnHeading, target=goal.target, speed=0.3)[0] == SUCCEEDED
    )
    assert math.dist(client.place, before) == pytest.approx(0.4, abs=0.15)
    goal.target.x = 0.1
    assert client.do("backup", BackUp, target=goal.target, speed=0.1)[0] == SUCCEEDED
    goal.target.x = 5.0
    status, result, _ = client.do("drive_on_heading", DriveOnHeading, target=goal.target, speed=0.3)
    assert (status, result.error_code) == (ABORTED, DriveOnHeading.Result.COLLISION_AHEAD)
    assert client.do("wait", Wait)[0] == SUCCEEDED
    planned = client.do("compute_path_to_pose", ComputePathToPose, goal=pose(0.2, 0.8))[1].path
    smooth = client.do("smooth_path", SmoothPath, path=planned)[1].path
    assert len(smooth.poses) == len(planned.poses) > 5 and planned.header.frame_id == "map"
    two = client.do(
        "compute_path_through_poses",
        ComputePathThroughPoses,
        goals=[pose(0.2, 0.8), pose(1.0, 0.8)],
    )
    assert len(two[1].path.poses) > len(planned.poses)
    assert client.do("follow_path", FollowPath, path=smooth)[0] == SUCCEEDED
    assert math.dist(client.place, (0.2, 0.8)) < 0.07


@slow
def test_what_cannot_be_done_says_why(client: Client) -> None:
    codes = ComputePathToPose.Result
    wrong = pose(0.5, 0.8)
    wrong.pose.orientation.w = 0.0
    for goal, code in (
        (pose(0.4, 1.2), codes.GOAL_OCCUPIED),
        (pose(0.4, 0.8, frame="nowhere"), codes.TF_ERROR),
        (pose(math.nan, 0.8), codes.TF_ERROR),
        (wrong, codes.TF_ERROR),
    ):
        status, result, _ = client.do("navigate_to_pose", NavigateToPose, pose=goal)
        assert (status, result.error_code) == (ABORTED, code) and result.error_msg, goal
        planned = client.do("compute_path_to_pose", ComputePathToPose, goal=goal)
        assert (planned[0], planned[1].error_code) == (ABORTED, code)
    far = {"pose": pose(1e5, 0.8)}
    no_poses = ComputePathThroughPoses.Result.NO_VIAPOINTS_GIVEN
    beyond = {"poses": [pose(0.5, 0.8)], "goal_index": 7}
    for name, kind, words, code in (
        ("navigate_to_pose", NavigateToPose, far, codes.GOAL_OUTSIDE_MAP),
        ("navigate_through_poses", NavigateThroughPoses, {}, no_poses),
        ("follow_waypoints", FollowWaypoints, beyond, FollowWaypoints.Result.UNKNOWN),
        ("follow_path", FollowPath, {}, FollowPath.Result.INVALID_PATH),
        ("smooth_path", SmoothPath, {}, SmoothPath.Result.INVALID_PATH),
        ("spin", Spin, {"target_yaw": math.nan}, Spin.Result.UNKNOWN),
        ("backup", BackUp, {"target": Point(y=1.0), "speed": 0.1}, BackUp.Result.INVALID_INPUT),
        ("backup", BackUp, {"target": Point(x=1.0)}, BackUp.Result.INVALID_INPUT),
    ):
        status, result, _ = client.do(name, kind, **words)
        assert (status, result.error_code) == (ABORTED, code) and result.error_msg, name
    around = "local_costmap/clear_costmap_around_robot"
    client.peer.call(ClearCostmapAroundRobot, around, reset_distance=math.nan)  # has no effect
    goal = {"pose": pose(0.5, 0.8)}
    assert client.send("navigate_to_pose", NavigateToPose, **goal, behavior_tree="mine") is None
    other = client.peer.publisher(PoseWithCovarianceStamped, "amcl_pose", LATCHED, subscribers=0)
    wait_for(lambda: client.send("navigate_to_pose", NavigateToPose, **goal) is None, "a refusal")
    client.peer.run(client.peer.node.destroy_publisher, other)
    client.do("navigate_to_pose", NavigateToPose, **goal)


@slow
def test_whoever_else_drives_takes_over_and_a_lock_ends_the_goal(client: Client) -> None:
    def begin() -> Any:
        sent = client.send("navigate_to_pose", NavigateToPose, pose=pose(1.4, 0.8))
        wait_for(lambda: not client.stands, "the robot to drive")
        return sent

    def ends(future: Any) -> Any:
        answer = wait_for(lambda: future.done() and future.result(), "the goal's end")
        wait_for(lambda: client.stands, "the robot to stop")
        return answer.status, answer.result.error_msg

    client.do("navigate_to_pose", NavigateToPose, pose=pose(0.0, 0.8))
    handle, _, ended = begin()
    client.peer.run(handle.cancel_goal_async)
    assert ends(ended)[0] == CANCELED
    _, _, ended = begin()
    other = client.peer.publisher(Twist, "velocity_controller/cmd_vel", subscribers=2)
    twist = Twist()
    twist.angular.z = 0.3
    other.publish(twist)
    assert ends(ended) == (ABORTED, "another node drives the robot")
    client.do("navigate_to_pose", NavigateToPose, pose=pose(0.0, 0.8))
    _, _, ended = begin()
    lock = client.peer.publisher(Bool, "velocity_controller/cmd_vel_lock")
    lock.publish(Bool(data=True))
    assert ends(ended) == (ABORTED, "the robot was locked")
    assert client.send("navigate_to_pose", NavigateToPose, pose=pose(0.0, 0.8)) is None
    lock.publish(Bool(data=False))
    wait_for(
        lambda: client.send("navigate_to_pose", NavigateToPose, pose=pose(0.0, 0.8)), "it to accept"
    )
    wait_for(lambda: client.status[-1].data == "arrived", "the robot to arrive")


@slow
def test_the_map_is_saved_and_used(client: Client, tmp_path: Path) -> None:
    """By the service, which Nav2's saver has, and by the command."""
    peer, file = client.peer, tmp_path / "maze"
    assert peer.call(SaveMap, "map_saver/save_map", map_url=str(file)).result
    saved = load_map(f"{file}.yaml")
    maps = peer.hear(OccupancyGrid, "map", LATCHED)
    published = wait_for(lambda: maps and maps[-1], "the map")
    assert saved.data.shape == (published.info.height, published.info.width)
    assert (saved.data == 100).sum() > 100 < (saved.data == 0).sum()
    answer = peer.call(LoadMap, "map_server/load_map", map_url=f"{file}.yaml")
    assert answer.result == LoadMap.Response.RESULT_SUCCESS
    assert client.do("navigate_to_pose", NavigateToPose, pose=pose(0.6, 0.8))[0] == SUCCEEDED
    assert math.dist(client.place, (0.6, 0.8)) < 0.07
    answer = peer.call(LoadMap, "map_server/load_map", map_url=str(tmp_path / "none.yaml"))
    assert answer.result == LoadMap.Response.RESULT_INVALID_MAP_DATA
    manage = peer.call(ManageLifecycleNodes, "lifecycle_manager_navigation/manage_nodes")
    assert manage.success


@slow
def test_commands_navigate_and_save(
    client: Client, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any
) -> None:
    monkeypatch.setenv("ROS_DOMAIN_ID", str(client.peer.node.context.get_domain_id()))
    assert onebot(["navigate", "0.0", "0.8", "-0.5"]) == 0
    assert "arrived at 0, 0.8 m" in capsys.readouterr().out
    assert math.dist(client.place, (0.0, 0.8)) < 0.07
    assert onebot(["navigate", "0.4", "1.2"]) == 1
    assert "206" in capsys.readouterr().err
    assert onebot(["navigate", "here"]) == 2
    assert onebot(["map", "save", str(tmp_path / "office")]) == 0
    assert load_map(tmp_path / "office.yaml").resolution == 0.05
