"""The steering page's tools: what becomes of clicks, and the requests of pages on real DDS."""

import io
import json
import math
import threading
import time
from array import array
from collections.abc import Iterator, Mapping
from contextlib import suppress
from typing import Any
from urllib.request import Request

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from geometry_msgs.msg import (
    PointStamped,
    PoseStamped,
    PoseWithCovarianceStamped,
    TransformStamped,
    Twist,
)
from nav_msgs.msg import OccupancyGrid, Odometry
from PIL import Image
from rcl_interfaces.msg import (
    FloatingPointRange,
    ParameterDescriptor,
    ParameterValue,
    SetParametersResult,
)
from sensor_msgs.msg import Image as ImageMessage
from sensor_msgs.msg import LaserScan
from std_msgs.msg import String

from onebot_bringup.introspection.parameter_values import parse_value, text_of
from onebot_bringup.steering.followed_topics import FollowedTopics
from onebot_bringup.steering.ground import Ground, picture
from onebot_bringup.steering.odometry_topic import OdometryTopic
from onebot_bringup.steering.protocol import ProtocolError, read_request
from onebot_bringup.steering.tool_requests import OtherThread
from onebot_bringup.steering.tools import Click, message_of
from onebot_bringup.steering.view_proxy import parse_displays
from onebot_description.errors import OneBotError
from onebot_description.ros.wire.interfaces import TFMessage
from tests.onebot_bringup.steering_support import BAD, PageClient, requested, steering
from tests.ros_support import LATCHED, Peer
from tests.support import PATIENCE, wait_for

CLICK = {
    "tool": "goal", "frame": "map", "x": 1.5, "y": -2, "yaw": math.pi / 2,
    "command_topic": "/robot1/cmd_vel",
}  # fmt: skip


def test_a_click_that_is_none_is_refused() -> None:
    assert read_request(Click, json.dumps(CLICK)) == Click(
        "goal", "map", 1.5, -2.0, math.pi / 2, "/robot1/cmd_vel"
    )
    for changes, problem in (
        ({"tool": "measure"}, "tool: no .measure. .*goal"),
        ({"frame": ""}, "frame: is empty"),
        ({"x": "1"}, "x: .* is a string; write a number"),
        ({"z": 0.0}, "z: no such parameter"),
    ):
        with pytest.raises(ProtocolError, match=problem):
            read_request(Click, json.dumps({**CLICK, **changes}))


def test_clicks_become_the_messages_of_rviz() -> None:
    """In type, frame, stamp, pose and covariance."""
    stamp = Time(sec=5)
    goal = message_of(Click("goal", "map", 1.0, 2.0, math.pi / 2, "/cmd_vel"), stamp)
    assert isinstance(goal, PoseStamped)
    assert (goal.header.frame_id, goal.header.stamp) == ("map", stamp)
    assert (goal.pose.position.x, goal.pose.position.y, goal.pose.position.z) == (1.0, 2.0, 0.0)
    turn = goal.pose.orientation
    assert (turn.x, turn.y, turn.z, turn.w) == pytest.approx((0.0, 0.0, 0.5**0.5, 0.5**0.5))

    estimate = message_of(Click("estimate", "map", 1.0, 2.0, math.pi / 2, "/cmd_vel"), stamp)
    assert isinstance(estimate, PoseWithCovarianceStamped)
    assert estimate.pose.pose == goal.pose and estimate.header == goal.header
    wanted = {0: 0.25, 7: 0.25, 35: math.radians(15.0) ** 2}
    assert dict(enumerate(estimate.pose.covariance)) == pytest.approx(
        {index: wanted.get(index, 0.0) for index in range(36)}
    )

    point = message_of(Click("point", "odom", 1.0, 2.0, 0.0, "/cmd_vel"), stamp)
    assert isinstance(point, PointStamped) and point.header.frame_id == "odom"
    assert (point.point.x, point.point.y, point.point.z) == (1.0, 2.0, 0.0)


def grid(width: int, height: int, cells: list[int]) -> OccupancyGrid:
    message = OccupancyGrid(data=array("b", cells))
    message.header.frame_id = "map"
    message.info.width, message.info.height, message.info.resolution = width, height, 0.5
    return message


def test_the_picture_of_a_map() -> None:
    """A pixel a cell, the first row at the bottom; what is unknown, or no probability, is clear."""
    png = picture(grid(3, 2, [0, 50, 100, -1, 0, 101]))
    pixels = np.asarray(Image.open(io.BytesIO(png)).convert("LA"))
    assert pixels[1].tolist() == [[255, 255], [128, 255], [0, 255]]
    assert pixels[0, :, 1].tolist() == [0, 255, 0]


@pytest.mark.parametrize(
    "fields",
    [
        {"type": 3, "double_value": math.inf},
        {"type": 4, "string_value": "true"},
        {"type": 4, "string_value": "two\nlines: 1"},
        {"type": 9, "string_array_value": ["a b", "1"]},
    ],
)
def test_values_as_text_are_read_as_they_were(fields: dict[str, Any]) -> None:
    value = ParameterValue(**fields)
    field, kind, read = parse_value(text_of(value), value.type)
    assert ParameterValue(type=kind, **{field: read}) == value
    assert text_of(ParameterValue()) == ""


LEGEND = {"kind": "trail", "name": "odometry", "color": [255, 176, 2]}


@pytest.mark.parametrize(
    "text", ["", "[]", "{}", '{"shown": [], "legend": [{"color": "red"}]}', "[" * 100_000]
)
def test_what_are_no_displays_shows_none(text: str) -> None:
    """Colors are as in CSS."""
    shown = [{"topic": "/a", "type": "std_msgs/msg/String", "visible": True}]
    displays = json.dumps({"shown": shown, "legend": [LEGEND]})
    assert parse_displays(displays) == (shown, [{**LEGEND, "color": "#ffb002"}])
    assert parse_displays(text) == ([], [])


# --- a node, and what a page requests ----------------------------------------------------------


class Requests:
    """What a page requests of a server."""

    def __init__(self, address: str) -> None:
        self.address = address.rstrip("/")

    def raw(self, path: str, body: Any = None) -> tuple[int, bytes]:
        data = None if body is None else json.dumps(body).encode()
        with requested(Request(f"{self.address}/tools/{path}", data)) as answer:
            return answer.status, answer.read()

    def __call__(self, path: str, body: Any = None) -> Mapping[str, Any]:
        """The response, or the error in it."""
        found: Mapping[str, Any] = json.loads(self.raw(path, body)[1])
        return found


def be_localised(peer: Peer) -> Any:
    """Publish a map, with the frames map -> odom, and odometry: 1 m ahead, in a map turned left.

    Returns:
        Publishes all but the map again.
    """
    shift = TransformStamped(child_frame_id="odom")
    shift.header.frame_id = "map"
    shift.transform.translation.x = 10.0
    shift.transform.rotation.z = shift.transform.rotation.w = 0.5**0.5
    odometry = Odometry(child_frame_id="base_link")
    odometry.header.frame_id = "odom"
    odometry.pose.pose.position.x = 1.0
    transforms = peer.node.create_publisher(TFMessage, "/tf_static", LATCHED)
    transforms.publish(TFMessage(transforms=[shift]))
    peer.node.create_publisher(OccupancyGrid, "/map", LATCHED).publish(grid(2, 1, [0, 100]))
    moved = peer.node.create_publisher(Odometry, "/odom", 10)
    return lambda: moved.publish(odometry)


def test_what_a_page_was_told_has_failed_does_not_happen_later(
    peer: Peer, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A node that is busy for long does it never; what it has begun by then is waited for."""
    monkeypatch.setattr("onebot_bringup.steering.tool_requests._TIMEOUT", 0.1)
    thread, executor = OtherThread(peer.node), peer.node.executor
    busy, free = threading.Event(), threading.Event()

    assert executor is not None
    executor.create_task(lambda: (busy.set(), free.wait(PATIENCE)))
    busy.wait(PATIENCE)
    late: list[str] = []
    with pytest.raises(OneBotError, match="is not answering"):
        thread.call(lambda: late.append("published"))
    free.set()

    def begun() -> str | None:
        with suppress(OneBotError):  # 0.1 s are short on a busy machine
            return thread.call(lambda: time.sleep(0.5) or "done")
        return None

    assert wait_for(begun, "the node") == "done"
    assert late == []


def test_the_ground_is_shown_when_transforms_had_time_to_come(peer: Peer) -> None:
    """Before, a click would be in another frame than a moment later."""
    topics = FollowedTopics(peer.node)
    ground = Ground(topics, OdometryTopic(topics, ""))
    assert ground.fields() == {}
    found = wait_for(ground.fields, "the ground")
    nothing = {"robot": None, "map": None, "scans": [], "path": [], "footprint": []}
    assert found == {"frame": "", "base": "", **nothing}


@pytest.fixture(scope="module")
def ask(domain: int) -> Iterator[Requests]:
    """What is requested of a node that several tests share."""
    with steering(topic="/robot1/cmd_vel") as node:
        yield Requests(node.address)


def test_a_page_sees_the_robot_on_the_map_and_clicks_there(domain: int, ask: Requests) -> None:
    """The frame is the map's; messages go to the robot that is steered."""
    with Peer(domain) as peer:
        goals = peer.hear(PoseStamped, "/robot1/goal_pose")
        peer.hear(Twist, "/robot1/cmd_vel")
        move = be_localised(peer)
        assert peer.node.count_subscribers("/map") == 0

        def localised() -> Mapping[str, Any] | None:
            move()
            found = ask("ground")
            return found if found["map"] and found["robot"] and found["frame"] == "map" else None

        ground = wait_for(localised, "the robot on the map")
        assert ground is not None and ground["base"] == "base_link"
        assert ground["robot"] == pytest.approx({"x": 10.0, "y": 1.0, "yaw": math.pi / 2})
        shown = {name: ground["map"][name] for name in ("x", "y", "yaw", "width", "height")}
        assert shown == {"x": 0.0, "y": 0.0, "yaw": 0.0, "width": 1.0, "height": 0.5}
        assert ask("ground?frame=odom")["robot"] == {"x": 1.0, "y": 0.0, "yaw": 0.0}
        status, png = ask.raw("map.png")
        assert status == 200 and Image.open(io.BytesIO(png)).size == (2, 1)

        assert ask("click", CLICK) == {"topic": "/robot1/goal_pose", "subscribers": 1}
        wait_for(lambda: goals, "the goal")
        assert goals[-1].header.frame_id == "map" and goals[-1].pose.position.x == 1.5
        assert abs(goals[-1].header.stamp.sec - peer.node.get_clock().now().nanoseconds / 1e9) < 60
        assert ground["command_topic"] == CLICK["command_topic"]
        count = len(goals)
        status, reason = ask.raw("click", {**CLICK, "command_topic": "/robot2/cmd_vel"})
        assert status == 409 and b"another robot is steered now" in reason
        assert ask.raw("click", {**CLICK, "x": None})[0] == 400
        wait_for(lambda: peer.node.count_subscribers("/map") == 0, "the end of what nobody sees")
        assert len(goals) == count


def test_a_map_has_the_scans_of_its_robot(domain: int, ask: Requests) -> None:
    """All, where their sensors were at the stamps, without a map too; not another robot's."""
    with Peer(domain, "lidars") as peer, Peer(domain, "other") as other:
        peer.hear(Twist, "/robot1/cmd_vel")
        other.hear(Twist, "/robot1/arm/cmd_vel")
        # The robot turned from +x to +y; its front lidar measured before that.
        moves = [
            pose("odom", "base_link", 1.0, turn, at) for at, turn in ((1, 0.0), (2, math.pi / 2))
        ]
        transforms = peer.node.create_publisher(TFMessage, "/tf", 10)
        fixed = peer.node.create_publisher(TFMessage, "/tf_static", LATCHED)
        fixed.publish(TFMessage(transforms=[pose("base_link", "rear", -0.5, math.pi, 0)]))
        scans = {
            "/robot1/front": scan("base_link", 1, 2.0, math.inf, 0.01, 9.0),
            "/robot1/back/scan": scan("rear", 2, 1.0),
            "/robot1/arm/scan": scan("base_link", 2, 3.0),
        }
        publishers = {name: peer.node.create_publisher(LaserScan, name, 10) for name in scans}

        def seen() -> list[list[float]]:
            for move in moves:
                transforms.publish(TFMessage(transforms=[move]))
            for name, publisher in publishers.items():
                publisher.publish(scans[name])
            return sorted(ask("ground?frame=odom")["scans"])

        behind, ahead = [1.0, -1.5], [3.0, 0.0]
        wait_for(lambda: seen() == [behind, ahead], "what the lidars of the robot hit")
        for name in scans:
            wait_for(lambda name=name: not peer.node.count_subscribers(name), "its end")


def pose(parent: str, child: str, x: float, yaw: float, stamp: int) -> TransformStamped:
    """A transform at a time in s."""
    transform = TransformStamped(child_frame_id=child)
    transform.header.frame_id, transform.header.stamp.sec = parent, stamp
    transform.transform.translation.x = x
    turn = transform.transform.rotation
    turn.z, turn.w = math.sin(yaw / 2), math.cos(yaw / 2)
    return transform


def scan(frame: str, stamp: int, *ranges: float) -> LaserScan:
    """A scan straight ahead, with rays a tenth of a radian apart."""
    message = LaserScan(angle_increment=0.1, range_min=0.1, range_max=8.0, ranges=ranges)
    message.header.frame_id, message.header.stamp.sec = frame, stamp
    return message


def test_a_page_sees_and_sets_the_parameters_of_a_node(domain: int, ask: Requests) -> None:
    """Those that can be set, with their ranges; and why the node refuses a value."""
    # A name of its own: the last test's peer may still be there.
    with Peer(domain, "robot") as peer:
        fine = FloatingPointRange(from_value=0.0, to_value=2.0)
        declare = peer.node.declare_parameter
        declare("speed", 0.5, ParameterDescriptor(description="m/s", floating_point_range=[fine]))
        declare("fixed", 1, ParameterDescriptor(read_only=True))
        declare("long", 2000 * "x")
        declare("lights", False)

        def check(parameters: Any) -> SetParametersResult:
            refused = any(one.name == "lights" for one in parameters)
            return SetParametersResult(successful=not refused, reason="no lights" * refused)

        peer.node.add_on_set_parameters_callback(check)
        wait_for(lambda: "/robot" in ask("nodes").get("nodes", ()), "the robot")
        assert ask("nodes")["viewer"] == ""
        found = ask("parameters?node=/robot")
        assert "error" not in found
        rows = {row["name"]: row for row in found["parameters"]}
        assert rows["speed"] == {
            "name": "speed", "type": "double", "value": "0.5", "description": "m/s", "rule": "",
            "read_only": False, "range": [0.0, 2.0],
        }  # fmt: skip
        assert rows["fixed"]["read_only"] and "long" not in rows
        for values in ({"speed": "\ud800"}, {"\ud800": "1"}):
            assert ask.raw("parameters", {"node": "/robot", "values": values})[0] == 400
        values = {"speed": "1", "lights": "true"}
        found = ask("parameters", {"node": "/robot", "values": values})
        assert found == {"rejected": {"lights": "no lights"}}
        assert peer.node.get_parameter("speed").value == 1.0
        found = ask("parameters", {"node": "/robot", "values": {"speed": "3.0"}})
        assert "speed" in found["rejected"]["speed"]
        assert "no node" in ask("parameters?node=/nobody")["error"]


def image(encoding: str) -> ImageMessage:
    """A picture of one pixel."""
    data = bytes({"rgb8": 3, "32FC1": 4}[encoding])
    return ImageMessage(encoding=encoding, width=1, height=1, step=len(data), data=data)


def test_the_cameras_of_a_robot_are_found_by_their_pictures(peer: Peer) -> None:
    """One message of each is enough; the viewer gets their topics; depth is left to it.

    Bytes that are no picture are ignored.
    """
    front, rear, depth = (f"/{name}/image_raw" for name in ("front", "rear", "measured"))
    messages = {front: image("rgb8"), rear: image("rgb8"), depth: image("32FC1")}
    create = peer.node.create_publisher
    publishers = {
        create(ImageMessage, topic, 1): message
        for topic, message in {"/broken": BAD, **messages}.items()
    }
    shown = peer.hear(String, "/rerun_viewer/page_cameras", LATCHED)

    timer = peer.node.create_timer(0.05, lambda: [p.publish(m) for p, m in publishers.items()])
    with steering(topic="/cmd_vel") as node:
        request = Requests(node.address)
        wait_for(lambda: shown, "the topic of the page's cameras")
        assert json.loads(shown[-1].data) == {"cameras": []}, "there is no page yet"
        with PageClient(node.address) as page:
            wait_for(lambda: page.state["cameras"] == [front, rear], "both cameras")
            for topic in messages:
                wait_for(lambda topic=topic: not peer.node.count_subscribers(topic), "its end")
            both = {"cameras": [front, rear]}
            wait_for(lambda: json.loads(shown[-1].data) == both, "the page's cameras")
            assert request.raw("camera.jpg?topic=/nowhere") == (204, b"")
            assert request.raw(f"camera.jpg?topic={depth}") == (204, b"")
            asked = f"camera.jpg?topic={rear}"
            wait_for(lambda: request.raw(asked)[0] == 200, "the picture of the rear")
            assert Image.open(io.BytesIO(request.raw(asked)[1])).format == "JPEG"
            assert not peer.node.count_subscribers(front)
    peer.run(peer.node.destroy_timer, timer)
