"""tf2_ros: buffers that wait, listeners and broadcasters on DDS, and types that are registered."""

import threading
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
import rclpy
import tf2_geometry_msgs
import tf2_ros
from builtin_interfaces.msg import Time as TimeMessage
from geometry_msgs.msg import (
    Point32,
    PointStamped,
    PolygonStamped,
    PoseStamped,
    PoseWithCovarianceStamped,
    Vector3Stamped,
)
from rclpy.action import ActionServer
from rclpy.duration import Duration
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from scipy.spatial.transform import Rotation

import onebot_description  # noqa: F401  (finds the packages)
from tests.onebot_description.test_tf2_buffer import LATEST, at, matrix, stamped
from tests.ros_support import node_here, spin_until
from tests.support import wait_for

QUARTER = (0.0, 0.0, 0.5**0.5, 0.5**0.5)


@pytest.fixture
def node(ros_domain: int) -> Iterator[Node]:
    with node_here("tf2") as node:
        yield node


def test_a_look_up_that_waits() -> None:
    """By a future, a coroutine, or blocking, while another thread adds the transform."""
    buffer = tf2_ros.Buffer(cache_time=Duration(seconds=5))
    future = buffer.wait_for_transform_async("a", "b", at(1.5))
    cancelled = buffer.wait_for_transform_full_async("a", at(1.0), "b", at(2.0), "a")
    waiting = buffer.lookup_transform_async("a", "b", LATEST)
    waiting.send(None)
    cancelled.cancel()
    buffer.set_transform(stamped("a", "b", 1.0), "me")
    assert not future.done() and not buffer.can_transform("a", "b", at(1.5))
    with pytest.raises(StopIteration) as result:
        waiting.send(None)
    assert result.value.value == stamped("a", "b", 1.0)
    later = threading.Timer(0.1, buffer.set_transform, (stamped("a", "b", 2.0, (4, 0, 0)), "me"))
    later.start()
    found = buffer.lookup_transform("a", "b", at(1.5), timeout=Duration(seconds=30))
    assert found.transform.translation.x == 2.0 == future.result().transform.translation.x
    assert buffer.wait_for_transform_async("a", "b", at(1.0)).result() == stamped("a", "b", 1.0)
    assert not buffer._waiting
    known, why = buffer.can_transform("a", "b", at(9.0), Duration(nanoseconds=1), True)
    assert not known and "extrapolation into the future" in why
    with pytest.raises(tf2_ros.ExtrapolationException):
        buffer.lookup_transform("a", "b", at(9.0), Duration(seconds=0.05))


def test_a_clock_that_is_set_back_clears_the_buffer(node: Node) -> None:
    buffer = tf2_ros.Buffer(node=node)
    buffer.set_transform(stamped("a", "b", 1.0), "me")
    node.set_parameters([rclpy.parameter.Parameter("use_sim_time", value=True)])
    assert not buffer.can_transform("a", "b", LATEST)
    client = node.create_client(buffer.srv.srv_type, "tf2_frames")
    answer = client.call_async(buffer.srv.srv_type.Request())
    spin_until(node, answer.done, "the frames")
    assert answer.result().frame_yaml == ""


def test_broadcasters_and_a_listener(node: Node) -> None:
    """Static transforms come to who listens later, all of them with each message."""
    moving, static = tf2_ros.TransformBroadcaster(node), tf2_ros.StaticTransformBroadcaster(node)
    static.sendTransform(stamped("base", "laser", 0.0, (0, 0, 1)))
    static.sendTransform([stamped("base", "imu", 0.0), stamped("base", "laser", 0.0, (9, 9, 9))])
    buffer = tf2_ros.Buffer()
    listener = tf2_ros.TransformListener(buffer, node)

    def sent() -> Any:
        moving.sendTransform((stamped("odom", "base", 1.0, (2, 0, 0), QUARTER),))
        return buffer.can_transform("odom", "laser", at(1.0)) and buffer.can_transform(
            "imu", "laser", LATEST
        )

    spin_until(node, sent, "the transforms")
    found = buffer.lookup_transform("odom", "laser", at(1.0))
    np.testing.assert_allclose(matrix(found)[:3, 3], [2, 0, 1])
    listener.unregister()
    assert not [one for one in node.subscriptions if one.topic_name.startswith("/tf")]


def test_a_listener_with_a_thread_of_its_own(node: Node) -> None:
    buffer, sender = tf2_ros.Buffer(), tf2_ros.StaticTransformBroadcaster(node)
    listener = tf2_ros.TransformListener(buffer, node, spin_thread=True)
    sender.sendTransform(stamped("a", "b", 0.0))
    wait_for(lambda: buffer.can_transform("a", "b", LATEST), "the transform")
    listener.executor.shutdown()
    listener.dedicated_listener_thread.join(30.0)
    assert not listener.dedicated_listener_thread.is_alive()


def test_a_client_of_a_buffer(node: Node) -> None:
    from tf2_msgs.action import LookupTransform

    core = tf2_ros.BufferCore()
    core.set_transform(stamped("a", "b", 1.0, (3, 0, 0)), "me")

    def execute(handle: Any) -> Any:
        result, goal = LookupTransform.Result(), handle.request
        try:
            names = goal.target_frame, goal.source_frame
            if goal.advanced:
                result.transform = core.lookup_transform_full_core(
                    names[0], goal.target_time, names[1], goal.source_time, goal.fixed_frame
                )
            else:
                result.transform = core.lookup_transform_core(*names, goal.source_time)
        except tf2_ros.LookupException as error:
            result.error.error, result.error.error_string = 1, str(error)
        except tf2_ros.TransformException as error:
            result.error.error, result.error.error_string = 3, str(error)
        handle.succeed()
        return result

    client = tf2_ros.BufferClient(node, "buffer")
    with pytest.raises(tf2_ros.TimeoutException, match="The BufferServer is not ready"):
        client.lookup_transform("a", "b", LATEST)
    server = ActionServer(node, LookupTransform, "buffer", execute)
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    thread = threading.Thread(target=executor.spin)
    thread.start()
    try:
        assert client.action_client.wait_for_server(30.0)
        assert client.lookup_transform("a", "b", LATEST).transform.translation.x == 3.0
        point = PointStamped()
        point.header.frame_id, point.header.stamp = "b", TimeMessage(sec=1)
        assert client.transform(point, "a").point.x == 3.0
        assert client.can_transform_full("a", at(1.0), "b", at(1.0), "a")
        with pytest.raises(tf2_ros.LookupException, match='"c" passed to lookupTransform'):
            client.lookup_transform("a", "c", LATEST)
        assert not client.can_transform("a", "b", at(2.0))
    finally:
        executor.shutdown()
        thread.join()
        server.destroy()
        client.destroy()


def test_registered_types_are_transformed() -> None:
    buffer = tf2_ros.Buffer()
    turn = Rotation.from_euler("xyz", [0.3, -0.2, 1.1])
    transform = stamped("map", "base", 1.0, (1, 2, 3), turn.as_quat())
    buffer.set_transform(transform, "me")
    messages = [PointStamped(), Vector3Stamped(), PoseStamped(), PoseWithCovarianceStamped()]
    for message in (*messages, polygon := PolygonStamped()):
        message.header.frame_id, message.header.stamp = "base", TimeMessage(sec=1)
    for place in (
        *(messages[0].point, messages[1].vector),
        *(messages[2].pose.position, messages[3].pose.pose.position),
    ):
        place.x, place.y, place.z = 4.0, 5.0, 6.0
    moved = turn.apply([4, 5, 6]) + [1, 2, 3]

    def numbers(place: Any) -> list[float]:
        return [place.x, place.y, place.z]

    point, vector, pose, uncertain = (buffer.transform(message, "map") for message in messages)
    np.testing.assert_allclose(numbers(point.point), moved, atol=1e-12)
    np.testing.assert_allclose(numbers(vector.vector), turn.apply([4, 5, 6]), atol=1e-12)
    np.testing.assert_allclose(numbers(pose.pose.position), moved, atol=1e-12)
    q = pose.pose.orientation
    np.testing.assert_allclose((q.x, q.y, q.z, q.w), turn.as_quat(), atol=1e-12)
    assert uncertain.pose.pose == pose.pose and point.header.frame_id == "map"
    covariance = np.arange(36.0)
    spread = np.kron(np.eye(2), turn.as_matrix())
    np.testing.assert_allclose(
        tf2_geometry_msgs.transform_covariance(covariance, transform).reshape(6, 6),
        spread @ covariance.reshape(6, 6) @ spread.T,
        atol=1e-12,
    )
    polygon.polygon.points = [Point32(x=4.0, y=5.0, z=6.0)]
    [corner] = buffer.transform_full(polygon, "map", at(1.0), "map").polygon.points
    np.testing.assert_allclose(numbers(corner), moved, atol=1e-6)
    assert transform.transform.translation.x == 1.0  # the argument stays as it is


def test_types_that_are_not_registered() -> None:
    buffer = tf2_ros.Buffer()
    with pytest.raises(tf2_ros.TypeException) as error:
        buffer.transform(stamped("a", "b", 1.0), "c")
    assert str(error.value) == (
        "Type <class 'geometry_msgs.msg._transform_stamped.TransformStamped'> is not loaded or "
        "supported"
    )
    with pytest.raises(tf2_ros.NotImplementedException):
        tf2_ros.BufferInterface().can_transform("a", "b", LATEST)
    registration = tf2_ros.ConvertRegistration()
    registration.add_to_msg(str, lambda text: PointStamped())
    registration.add_convert((PointStamped, float), lambda point: point.point.x)
    assert tf2_ros.convert("", PointStamped) == PointStamped()
    assert tf2_ros.convert(PointStamped(), float) == 0.0
    assert tf2_ros.convert(1.5, float) == 1.5
    point = tf2_ros.Stamped(PointStamped(), TimeMessage(sec=2), "map")
    assert point.header.frame_id == "map" and point.header.stamp.sec == 2


def test_names_of_the_genuine_package() -> None:
    """Those that its modules import, too, as people import them from there."""
    from tf2_geometry_msgs import PoseStamped as Registered
    from tf2_ros import BufferClient, Duration, TransformStamped

    assert TransformStamped.__name__ == "TransformStamped" and Registered is PoseStamped
    assert BufferClient is tf2_ros.buffer_client.BufferClient and Duration(seconds=1)
    for name in ("Nothing", "__path_of__"):
        with pytest.raises(AttributeError, match=f"module 'tf2_ros' has no attribute '{name}'"):
            getattr(tf2_ros, name)
