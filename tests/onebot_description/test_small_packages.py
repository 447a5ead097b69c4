"""The small packages: point clouds, pictures, rotations, angles, and messages as dictionaries."""

import math
from pathlib import Path
from typing import Any

import angles
import numpy as np
import pytest
import tf_transformations as tf
from cv_bridge import CvBridge, CvBridgeError, getCvType
from geometry_msgs.msg import PolygonStamped, TransformStamped
from rosidl_runtime_py import (
    get_interface_packages,
    get_interface_path,
    get_interfaces,
    get_service_interfaces,
    message_to_ordereddict,
    message_to_yaml,
    set_message_fields,
)
from rosidl_runtime_py.utilities import get_action, get_message, get_service
from scipy.spatial.transform import Rotation
from sensor_msgs.msg import CompressedImage, Image, JointState, PointCloud2, PointField
from sensor_msgs_py import point_cloud2
from std_msgs.msg import Header
from tf2_sensor_msgs import do_transform_cloud

import onebot_description  # noqa: F401  (finds the packages)

POINTS = np.array([(1, 2, 3, 7), (4, math.nan, 6, 8), (-1, 0, 1, 9), (0, 0, 0, 5)], float)


def cloud(step: int = 24, big: bool = False) -> PointCloud2:
    """Four points, 2 x 2, with x, y, z as 32-bit floats and a 16-bit ring, padded to a step."""
    names = [("x", 0, 7), ("y", 4, 7), ("z", 8, 7), ("ring", 16, 4)]
    fields = [PointField(name=n, offset=at, datatype=kind, count=1) for n, at, kind in names]
    order = ">" if big else "<"
    dtype = np.dtype(
        {"names": [n for n, _, _ in names], "formats": [f"{order}f4"] * 3 + [f"{order}u2"],
         "offsets": [at for _, at, _ in names], "itemsize": step}
    )  # fmt: skip
    points = np.zeros(4, dtype)
    for column, name in enumerate(dtype.names or ()):
        points[name] = POINTS[:, column]
    return PointCloud2(
        header=Header(frame_id="laser"), height=2, width=2, fields=fields, point_step=step,
        row_step=2 * step, data=points.tobytes(), is_bigendian=big,
    )  # fmt: skip


@pytest.mark.parametrize("big", [False, True])
def test_points_of_a_cloud(big: bool) -> None:
    message = cloud(big=big)
    before = bytes(message.data)
    for _ in range(2):  # reading changes nothing
        points = point_cloud2.read_points(message)
        np.testing.assert_array_equal(points["y"], POINTS[:, 1])
        assert points["ring"].tolist() == [7, 8, 9, 5] and bytes(message.data) == before
    xyz = point_cloud2.read_points_numpy(message, ("x", "y", "z"), skip_nans=True)
    np.testing.assert_array_equal(xyz, POINTS[[0, 2, 3], :3])
    assert point_cloud2.read_points(message, uvs=[2, 0])["x"].tolist() == [-1, 1]
    assert point_cloud2.read_points(message, reshape_organized_cloud=True).shape == (2, 2)
    assert point_cloud2.read_points_list(message)[3].ring == 5
    with pytest.raises(AssertionError, match="not in the fields"):
        point_cloud2.read_points(message, ["intensity"])
    with pytest.raises(AssertionError, match="same datatype"):
        point_cloud2.read_points_numpy(message)


def test_a_cloud_of_points() -> None:
    made = point_cloud2.create_cloud_xyz32(Header(frame_id="map"), POINTS[:, :3])
    assert (made.width, made.height, made.point_step, made.row_step) == (4, 1, 12, 48)
    np.testing.assert_array_equal(point_cloud2.read_points_numpy(made), POINTS[:, :3])
    field = PointField(name="v", offset=2, datatype=PointField.INT16, count=2)
    pairs = point_cloud2.create_cloud(Header(), [field], [(1, -2), (3, -4)], 8)
    assert bytes(pairs.data)[:8] == b"\0\0\1\0\xfe\xff\0\0"
    assert point_cloud2.read_points(pairs)["v_1"].tolist() == [-2, -4]
    with pytest.raises(AssertionError, match="Duplicate field names"):
        point_cloud2.dtype_from_fields([field, field])


def test_a_cloud_in_another_frame() -> None:
    """Padding, rows and other fields stay as they are."""
    turn = Rotation.from_euler("xyz", [0.1, 0.2, 0.3])
    transform = TransformStamped(header=Header(frame_id="map"))
    at, q = transform.transform.translation, transform.transform.rotation
    at.x, at.y, at.z = 1.0, 2.0, 3.0
    q.x, q.y, q.z, q.w = turn.as_quat().tolist()
    message = cloud()
    moved = do_transform_cloud(message, transform)
    points = point_cloud2.read_points_numpy(moved, ["x", "y", "z"])
    expected = POINTS[:, :3] @ turn.as_matrix().T + [1, 2, 3]
    np.testing.assert_allclose(points, expected, rtol=1e-6)
    assert point_cloud2.read_points(moved)["ring"].tolist() == [7, 8, 9, 5]
    assert (moved.height, moved.point_step, moved.header.frame_id) == (2, 24, "map")
    assert message == cloud()


BRIDGE = CvBridge()


def test_pictures_there_and_back() -> None:
    random = np.random.default_rng(3)
    for dtype, name in (("uint8", "8U"), ("int16", "16S"), ("float32", "32F"), (">i4", "32S")):
        for channels in (1, 3, 5):
            picture = random.integers(0, 99, (4, 6, channels)).astype(dtype)
            message = BRIDGE.cv2_to_imgmsg(picture, header=Header(frame_id="camera"))
            assert (message.encoding, message.header.frame_id) == (f"{name}C{channels}", "camera")
            assert message.is_bigendian == (dtype == ">i4")
            assert (BRIDGE.imgmsg_to_cv2(message) == np.squeeze(picture)).all()
    padded = Image(height=2, width=2, step=3, encoding="mono8", data=b"\1\2\xff\3\4\xff")
    assert BRIDGE.imgmsg_to_cv2(padded).tolist() == [[1, 2], [3, 4]]
    with pytest.raises(CvBridgeError, match="wrongly formed"):
        BRIDGE.imgmsg_to_cv2(Image(height=3, width=2, step=2, encoding="mono8", data=b"\1\2\3"))


@pytest.mark.parametrize(
    "source, pixel, target, expected",
    [
        ("rgb8", (200, 100, 50), "bgr8", (50, 100, 200)),
        ("bgr8", (200, 100, 50), "rgba8", (50, 100, 200, 255)),
        ("rgb8", (200, 100, 50), "mono8", 124),  # 0.299, 0.587, 0.114
        ("rgb8", (200, 100, 50), "mono16", 124 * 257),
        ("yuv422", (90, 81), "rgb8", (15, 121, 0)),
        ("yuv422_yuy2", (81, 90), "mono8", 81),
        ("bayer_rggb8", 60, "rgb8", (60, 60, 60)),
        ("8UC3", (1, 2, 3), "32FC3", (1, 2, 3)),
    ],
)
def test_colors(source: str, pixel: Any, target: str, expected: Any) -> None:
    """With the weights and rounding of OpenCV."""
    dtype, channels = BRIDGE.encoding_to_dtype_with_channels(source)
    picture = np.empty((6, 6, channels), dtype)
    picture[:] = pixel
    message = BRIDGE.cv2_to_imgmsg(picture, source)
    result = BRIDGE.imgmsg_to_cv2(message, target)
    assert result.dtype == BRIDGE.encoding_to_dtype_with_channels(target)[0]
    np.testing.assert_array_equal(result[3, 3], expected)


def test_the_colors_of_a_mosaic() -> None:
    """Of a red picture, only the red places of the mosaic have a value."""
    mosaic = np.zeros((6, 8), np.uint8)
    mosaic[1::2, 0::2] = 80  # the second row of "gbrg" begins with red
    message = BRIDGE.cv2_to_imgmsg(mosaic, "bayer_gbrg8")
    assert (BRIDGE.imgmsg_to_cv2(message, "rgb8") == (80, 0, 0)).all()


def test_pictures_that_cannot_be_converted() -> None:
    message = BRIDGE.cv2_to_imgmsg(np.zeros((2, 2, 3), np.uint8))
    for target, text in (
        ("mono8", r"Unsupported conversion from \[8UC3\] to \[mono8\]"),
        ("8UC1", r"Unsupported conversion from \[8UC3\] to \[8UC1\]"),
        ("purple", r"Unrecognized image encoding \[purple\]"),
    ):
        with pytest.raises(CvBridgeError, match=text):
            BRIDGE.imgmsg_to_cv2(message, target)
    with pytest.raises(CvBridgeError, match=r"Unsupported conversion from \[rgb8\] to \[bayer_rg"):
        BRIDGE.imgmsg_to_cv2(BRIDGE.cv2_to_imgmsg(np.zeros((2, 2, 3), np.uint8), "rgb8"),
                             "bayer_rggb8")  # fmt: skip
    with pytest.raises(CvBridgeError, match="as rgba8, but image has incompatible type 8UC3"):
        BRIDGE.cv2_to_imgmsg(np.zeros((2, 2, 3), np.uint8), "rgba8")
    with pytest.raises(TypeError, match="Your input type is not a numpy array"):
        BRIDGE.cv2_to_imgmsg([[1]])
    with pytest.raises(CvBridgeError, match="not a picture"):
        BRIDGE.compressed_imgmsg_to_cv2(CompressedImage(data=b"nothing"))
    assert getCvType("32FC4") == 29
    with pytest.raises(ImportError, match="cvtColorForDisplay"):
        from cv_bridge import cvtColorForDisplay  # noqa: F401


def test_compressed_pictures() -> None:
    picture = np.random.default_rng(4).integers(0, 255, (8, 10, 4)).astype(np.uint8)
    for channels in (1, 3, 4):
        part = picture[..., 0] if channels == 1 else picture[..., :channels]
        message = BRIDGE.cv2_to_compressed_imgmsg(part, "png")
        assert message.format == "png"
        assert (BRIDGE.compressed_imgmsg_to_cv2(message) == part).all()
    deep = picture[..., 0].astype(np.uint16) * 250
    message = BRIDGE.cv2_to_compressed_imgmsg(deep, "png")
    assert (BRIDGE.compressed_imgmsg_to_cv2(message, "mono16") == deep).all()
    flat = np.full((16, 16, 3), (10, 200, 90), np.uint8)
    photo = BRIDGE.compressed_imgmsg_to_cv2(BRIDGE.cv2_to_compressed_imgmsg(flat), "rgb8")
    assert abs(photo.astype(int) - [90, 200, 10]).max() <= 3
    with pytest.raises(CvBridgeError, match="cannot be written as xyz"):
        BRIDGE.cv2_to_compressed_imgmsg(flat, "xyz")


def test_rotations_by_three_angles() -> None:
    """All 24 orders of axes, against SciPy's."""
    random = np.random.default_rng(5)
    assert len(tf._AXES2TUPLE) == 24 and tf._AXES2TUPLE["ryxz"] == (2, 0, 0, 1)
    for axes, code in tf._AXES2TUPLE.items():
        values = random.uniform(-3.0, 3.0, 3)
        order = axes[1:] if axes[0] == "s" else axes[1:].upper()
        expected = Rotation.from_euler(order, values).as_matrix()
        matrix = tf.euler_matrix(*values, axes)
        np.testing.assert_allclose(matrix[:3, :3], expected, atol=1e-12)
        np.testing.assert_allclose(tf.euler_matrix(*values, code), matrix)
        back = tf.euler_from_quaternion(tf.quaternion_from_euler(*values, axes), axes)
        np.testing.assert_allclose(tf.euler_matrix(*back, axes), matrix, atol=1e-12)
    np.testing.assert_allclose(
        tf.quaternion_from_euler(1, 2, 3, "ryxz"), [0.310622, -0.718287, 0.444435, 0.435953],
        atol=1e-6,
    )  # fmt: skip
    assert tf.euler_from_quaternion((0.0, 0.0, 1.0, 0.0)) == pytest.approx((0, 0, math.pi))
    assert tf.euler_from_matrix(tf.euler_matrix(0.3, math.pi / 2, 0.0)) == pytest.approx(
        (0.3, math.pi / 2, 0.0)
    )


def test_quaternions() -> None:
    first, second = Rotation.random(2, np.random.default_rng(6))
    a, b = first.as_quat(), second.as_quat()
    np.testing.assert_allclose(tf.quaternion_matrix(3 * a)[:3, :3], first.as_matrix(), atol=1e-12)
    product = Rotation.from_quat(tf.quaternion_multiply(a, b))
    np.testing.assert_allclose(product.as_matrix(), (first * second).as_matrix(), atol=1e-12)
    np.testing.assert_allclose(
        tf.quaternion_multiply(2 * a, tf.quaternion_inverse(2 * a)), [0, 0, 0, 1], atol=1e-12
    )
    found = tf.quaternion_from_matrix(tf.quaternion_matrix(a))
    assert found[3] >= 0 and abs(abs(np.dot(found, a)) - 1.0) < 1e-12
    np.testing.assert_allclose(
        tf.quaternion_about_axis(0.5, (0, 0, 9)), [0, 0, math.sin(0.25), math.cos(0.25)]
    )
    half = Rotation.from_quat(tf.quaternion_slerp(a, -a * 0 - b, 0.5))
    assert (half * first.inv()).magnitude() == pytest.approx((second * first.inv()).magnitude() / 2)
    for turn in (tf.random_quaternion(), tf.quaternion_from_matrix(tf.random_rotation_matrix())):
        assert tf.vector_norm(turn) == pytest.approx(1.0)


def test_matrices() -> None:
    parts = [2.0, 3.0, 0.5], [0.1, -0.2, 0.3], [0.4, -0.5, 0.6], [7.0, 8.0, 9.0]
    found = tf.decompose_matrix(tf.compose_matrix(*parts))
    for part, expected in zip(found, parts, strict=False):
        np.testing.assert_allclose(part, expected, atol=1e-12)
    turn = tf.rotation_matrix(1.2, (1, 2, 3), (4, 5, 6))
    np.testing.assert_allclose(turn @ [4, 5, 6, 1], [4, 5, 6, 1])
    assert tf.is_same_transform(tf.rotation_matrix(*tf.rotation_from_matrix(turn)), turn)
    moved = tf.concatenate_matrices(tf.translation_matrix((1, 2, 3)), turn, tf.inverse_matrix(turn))
    np.testing.assert_allclose(tf.translation_from_matrix(moved), [1, 2, 3])
    np.testing.assert_allclose(tf.unit_vector([[3, 4], [0, 2]], axis=1), [[0.6, 0.8], [0, 1]])
    points = np.random.default_rng(7).normal(size=(3, 9))
    onto = tf.superimposition_matrix(points, 2.0 * turn[:3, :3] @ points + 1.0, scaling=True)
    np.testing.assert_allclose(onto[:3], np.c_[2.0 * turn[:3, :3], np.ones(3)], atol=1e-12)
    with pytest.raises(AttributeError, match="tf_transformations' has no attribute 'Arcball'"):
        _ = tf.Arcball


def test_angles() -> None:
    assert angles.normalize_angle(3.5 * math.pi) == pytest.approx(-0.5 * math.pi)
    assert angles.normalize_angle_positive(-0.5) == pytest.approx(2 * math.pi - 0.5)
    assert angles.shortest_angular_distance(3.0, -3.0) == pytest.approx(2 * math.pi - 6.0)
    assert angles.two_pi_complement(0.5) == pytest.approx(0.5 - 2 * math.pi)
    within = angles.shortest_angular_distance_with_limits
    assert within(-0.5, 0.5, -1.0, 1.0) == (True, pytest.approx(1.0))
    assert within(-0.5, 0.5, 0.25, -0.25) == (True, pytest.approx(1.0 - 2 * math.pi))
    assert within(-0.5, 0.5, -0.25, 0.25)[0] is False
    large = angles.shortest_angular_distance_with_large_limits
    assert large(0, 10.5 * math.pi, -2 * math.pi, 2 * math.pi) == (
        True, pytest.approx(0.5 * math.pi)
    )  # fmt: skip
    assert large(0, 10.5 * math.pi, -2 * math.pi, 0.1 * math.pi) == (
        True, pytest.approx(-1.5 * math.pi)
    )  # fmt: skip
    assert large(0, 1, 2, -2)[0] is False


def test_messages_as_dictionaries() -> None:
    state = JointState(name=["a", "b", "c"], position=[1.0, 2.0, 3.0])
    state.header.frame_id = "long name"
    fields = message_to_ordereddict(state, truncate_length=2)
    assert fields["name"] == ["a", "b", "..."] and fields["header"]["frame_id"] == "lo..."
    assert message_to_yaml(state, flow_style=True).startswith("{header: {stamp: {sec: 0,")
    assert message_to_ordereddict(state, no_arr=True, no_str=True)["name"] == (
        "<sequence type: string, length: 3>"
    )
    polygon = PolygonStamped()
    now = set_message_fields(
        polygon,
        {"header": "auto", "polygon": {"points": [{"x": 1.0}, {"y": 2.0}]}},
        expand_header_auto=True,
    )
    now[0](type(polygon.header.stamp)(sec=5))
    assert polygon.header.stamp.sec == 5 and polygon.polygon.points[1].y == 2.0
    set_message_fields(state, {"position": [4], "header": {"frame_id": "x"}})
    assert list(state.position) == [4.0] and state.header.frame_id == "x"
    with pytest.raises(AttributeError, match="speed"):
        set_message_fields(state, {"speed": 1.0})
    with pytest.raises(TypeError, match="expected to be a dictionary but is a int"):
        set_message_fields(state, {"header": 3})


def test_interfaces_by_their_names() -> None:
    assert get_interfaces(["tf2_msgs"])["tf2_msgs"] == [
        "msg/TF2Error", "msg/TFMessage", "srv/FrameGraph", "action/LookupTransform"
    ]  # fmt: skip
    assert get_service_interfaces(["std_srvs"])["std_srvs"][0] == "srv/Empty"
    assert Path(get_interface_packages()["std_msgs"], "msg/String.msg").is_file()
    for name in ("std_msgs/msg/String", "std_msgs/msg/String.msg", "nav2_msgs/msg/Costmap"):
        assert Path(get_interface_path(name)).is_file()
    for function, argument in ((get_interfaces, ["no_msgs"]), (get_interface_path, "no_msgs/msg")):
        with pytest.raises(LookupError, match="no_msgs"):
            function(argument)
    assert get_message("sensor_msgs/JointState") is get_message("sensor_msgs/msg/JointState")
    assert hasattr(get_service("std_srvs/srv/Trigger"), "Request")
    assert hasattr(get_action("tf2_msgs/action/LookupTransform"), "Goal")
    with pytest.raises(ValueError, match="Expected the full name of a message, got 'std_srvs/srv"):
        get_message("std_srvs/srv/Trigger")
