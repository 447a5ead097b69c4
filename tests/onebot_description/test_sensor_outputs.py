"""What plugins in a <sensor> publish, on which topics and within which limits; and what is none."""

import math
import re

import pytest

from onebot_description.description import describe
from onebot_description.description.loading import parse_description
from onebot_description.description.sensors.noise import Noise
from tests.onebot_description.sensor_blocks import (
    RAY,
    VALUES,
    block,
    camera,
    plugin,
    rays,
    read,
    ros,
)

CLASSIC, SONAR = "libgazebo_ros_camera.so", "libhector_gazebo_ros_sonar.so"


def topics(found) -> dict[str, str]:
    """The topics of all sensors, without a fault."""
    assert found.problems == ()
    return {output: topic for sensor in found.sensors for output, topic in sensor.topics.items()}


def child(**texts: object) -> str:
    return "".join(f"<{tag}>{text}</{tag}>" for tag, text in texts.items())


# Names --------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("inside", "expected"),
    [
        (child(topic="__default_topic__") + plugin(ros("~/out:=imu/data")), "imu/data"),
        (plugin(child(topicName="__default_topic__", frameName="a"), "libimu.so"), "imu"),
        (child(topic="own") + plugin(ros("~/out:=remapped")), "remapped"),
    ],
)
def test_the_placeholder_of_sdformat_names_no_topic(inside, expected):
    assert topics(read(block(kind="imu", inside=inside))) == {"imu": expected}


@pytest.mark.parametrize(
    ("inside", "expected"),
    [
        (ros("/p/out:=scan"), "scan"),
        (ros("~/out:=~/scan"), "p/scan"),
        (ros("~/out:=scan", namespace="front/left/"), "front/left/scan"),
        (ros("~/out:=/scan", namespace="/front"), "/scan"),
        (ros("/front/p/out:=scan", namespace="/front"), "front/scan"),
        ("<ros><argument>~/out:=scan</argument></ros>", "scan"),
        (ros(namespace="front"), "front/p/out"),
        ("", "p/out"),
        (child(topicName="scan", robotNamespace="/front"), "front/scan"),
        (child(topicName="/scan", robotNamespace="front"), "/scan"),
    ],
)
def test_a_lidar_s_topic_is_that_of_gazebo_ros(inside, expected):
    found = read(rays(plugin(child(output_type="sensor_msgs/LaserScan") + inside)))
    assert topics(found) == {"scan": expected} and found.warnings == ()


NAMES = ("image", "camera_info", "depth", "depth_camera_info", "points")
OLD_NAMES = (
    "imageTopicName",
    "cameraInfoTopicName",
    "depthImageTopicName",
    "depthImageCameraInfoTopicName",
    "pointCloudTopicName",
)


def left_eye(*rules: str) -> str:
    """What a plugin holds whose namespace is left and whose camera is eye."""
    return ros(*rules, namespace="left") + child(camera_name="eye")


DEFAULT = ("image_raw", "camera_info", "depth/image_raw", "depth/camera_info", "points")


@pytest.mark.parametrize(
    ("inside", "expected"),
    [
        ("", [f"s/{name}" for name in DEFAULT]),
        (child(camera_name="/eye"), [f"/eye/{name}" for name in DEFAULT]),
        (left_eye(), [f"left/eye/{name}" for name in DEFAULT]),
        # Relative, absolute, one after another, of each topic.
        (
            left_eye(*[f"eye/{name}:=my/n{n}" for n, name in enumerate(DEFAULT)]),
            [f"left/my/n{n}" for n in range(5)],
        ),
        (
            left_eye(*[f"/left/eye/{name}:=/my/n{n}" for n, name in enumerate(DEFAULT)]),
            [f"/my/n{n}" for n in range(5)],
        ),
        (  # as the plugin's documentation has it: below the camera's name
            left_eye("image_raw:=picture", "camera_info:=/info"),
            ["left/eye/picture", "/info", *[f"left/eye/{name}" for name in DEFAULT[2:]]],
        ),
        (
            child(cameraName="eye", robotNamespace="left")
            + child(**{tag: f"my/n{n}" for n, tag in enumerate(OLD_NAMES)}),
            [f"left/eye/my/n{n}" for n in range(5)],
        ),
        (child(imageTopicName="picture"), ["picture", *DEFAULT[1:]]),
    ],
)
def test_a_camera_s_topics_are_namespace_camera_name_and_topic(inside, expected):
    found = read(camera(plugin=plugin(inside, CLASSIC), kind="depth"))
    assert topics(found) == dict(zip(NAMES, expected, strict=True)) and found.notices == ()


@pytest.mark.parametrize(
    ("first", "second", "info"),
    [
        (("camera", "camera/image_raw"), ("depth_camera", "camera/depth"), "camera/camera_info"),
        (("camera", "front"), ("camera", "rear"), "camera_info"),
        (("rgbd_camera", "cam"), ("camera", "cam/rear"), "cam/camera_info"),
    ],
)
def test_cameras_below_one_name_share_their_camera_info_as_in_gz(first, second, info):
    blocks = [
        camera(name=f"c{n}", kind=kind, plugin=child(topic=topic))
        for n, (kind, topic) in enumerate((first, second))
    ]
    found = read(*blocks)
    assert found.problems == () and len(found.sensors) == 2
    assert {sensor.topics["camera_info"] for sensor in found.sensors} == {info}
    (notice,) = found.warnings
    assert notice.startswith('r:3: <gazebo> sensor "c1"') and "the one at r:2" in notice
    assert f'"{info}"' in notice and "<camera_info_topic>" in notice
    own = child(topic=second[1], camera_info_topic="own/info")
    found = read(blocks[0], camera(name="c1", kind=second[0], plugin=own))
    assert found.notices == () and found.sensors[1].topics["camera_info"] == "own/info"


def test_an_image_and_a_camera_info_do_not_share_a_topic():
    info = camera(name="b", plugin=child(topic="x/camera_info"))
    assert "x/camera_info" in read(camera(name="a", plugin=child(topic="x/y")), info).problems[0]


def test_sensors_of_one_name_on_two_links_have_the_link_in_their_topics():
    """As gz sim has it; a macro that is used twice gives them one name."""
    links = (
        '<link name="b"/><joint name="j" type="fixed"><parent link="a"/><child link="b"/></joint>'
    )
    for first, second, named in (
        (rays(), rays(), "s/scan"),
        (rays(rows=4), rays(rows=4), "s/points"),
        (camera(), camera(kind="rgbd_camera"), "s/image_raw"),
    ):
        found = read(first, second.replace('reference="a"', 'reference="b"'), links)
        assert found.problems == ()
        names = [next(iter(sensor.topics.values())) for sensor in found.sensors]
        assert names == [f"a/{named}", f"b/{named}"]
    assert "give it its own <topic>" in read(rays(), rays()).problems[0]  # two on one link


def test_a_sensor_s_name_becomes_a_part_of_a_topic():
    found = read(block("2d lidar"), block("Lidar é"))
    assert found.problems == ()
    scans = [each.topics["scan"] for each in found.sensors]
    assert scans == ["sensor_2d_lidar/scan", "Lidar__/scan"]


@pytest.mark.parametrize(
    "written",
    [
        camera(plugin=child(topic="camera_info")),
        camera(f"<camera_info_topic>x</camera_info_topic>{child(topic='x')}"),
    ],
)
def test_two_outputs_of_a_sensor_on_one_topic_are_a_fault(written):
    found = read(written)
    (problem,) = found.problems
    assert found.sensors == ()
    assert re.search(
        r'r:2: .*sensor "s": publishes two outputs on "(x|camera_info)"; give', problem
    )


def test_cameras_of_different_types_without_topics_are_named_by_themselves():
    """Those whose outputs differ share a name: a color camera and a depth camera."""
    kinds = {"color": "camera", "all": "rgbd_camera", "depth": "depth_camera"}

    def images(*names):
        found = read(*(camera(name=name, kind=kinds[name]) for name in names))
        assert found.problems == ()
        return [next(iter(sensor.topics.values())) for sensor in found.sensors]

    assert images("color", "depth") == ["camera/image_raw", "camera/depth/image_raw"]
    assert images("color", "all") == ["color/image_raw", "all/image_raw"]
    assert images("all", "depth") == ["all/image_raw", "depth/depth/image_raw"]
    assert images(*kinds) == ["color/image_raw", "all/image_raw", "depth/depth/image_raw"]


def test_lidars_of_one_ray_leave_the_scan_to_the_one_that_scans():
    one = RAY.format(**VALUES | {"samples": 1})
    found = read(block("cliff", inside=one), block("laser"), block("ir", inside=one))
    assert [sensor.topics["scan"] for sensor in found.sensors] == ["cliff/scan", "scan", "ir/scan"]
    assert topics(read(block("laser", inside=one)))["scan"] == "scan"
    found = read(rays(rows=5, name="left"), rays(rows=5, name="right"), block("laser"))
    names = [found.sensors[0].topics["points"], found.sensors[2].topics["scan"]]
    assert names == ["left/points", "scan"]  # clouds are no rivals of a scan


@pytest.mark.parametrize(
    ("inside", "expected"),
    [
        ("", "a"),
        (child(frame_name="b"), "b"),
        (child(frameName="/b"), "b"),
    ],
)
def test_a_plugin_s_frame_is_that_of_its_messages(inside, expected):
    joint = '<joint name="j" type="fixed"><parent link="a"/><child link="b"/></joint>'
    own = plugin(ros("~/out:=own") + inside)
    other = plugin(ros("~/out:=other"), name="q")
    found = read(rays(own, other), f'<link name="b"/>{joint}')
    assert [sensor.frame for sensor in found.sensors] == [expected, "a"]
    assert found.notices == ()


# Types --------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("inside", "file", "output"),
    [
        (child(output_type="sensor_msgs/LaserScan"), "libgazebo_ros_ray_sensor.so", "scan"),
        (child(output_type="sensor_msgs/PointCloud2"), "libgazebo_ros_ray_sensor.so", "points"),
        (child(output_type="sensor_msgs/PointCloud"), "libgazebo_ros_ray_sensor.so", "point_cloud"),
        (child(output_type="sensor_msgs/msg/Range"), "libgazebo_ros_ray_sensor.so", "range"),
        (child(outputType="sensor_msgs/LaserScan"), "libgazebo_ros_ray_sensor.so", "scan"),
        ("", "libgazebo_ros_ray_sensor.so", "points"),
        ("", "libgazebo_ros_gpu_laser.so", "scan"),
        ("", "libgazebo_ros_block_laser.so", "point_cloud"),
        ("", "libgazebo_ros_range.so", "range"),
        ("", SONAR, "range"),
        ("", "libgazebo_ros_velodyne_gpu_laser.so", "points"),
        ("", "libgazebo_ros_ouster_laser.so", "points"),
    ],
)
def test_a_plugin_decides_what_is_made_of_rays_not_their_rows(inside, file, output):
    for rows in (1, 4):
        found = read(rays(plugin(inside + child(topicName="here"), file), rows=rows))
        assert topics(found) == {output: "here"} and found.warnings == ()


def test_without_a_plugin_a_lidar_has_a_scan_and_a_cloud_as_in_gz():
    """Of a scan and a cloud, the one that the rows suggest comes first and has the usual name."""
    one_row = {"scan": "scan", "points": "scan/points"}
    assert topics(read(rays())) == topics(read(rays(child(topic="scan"), rows=4))) == one_row
    assert topics(read(rays(rows=4))) == {"points": "points", "scan": "s/scan"}
    named = topics(read(rays(child(topic="/base/scan"))))
    assert named == {"scan": "base/scan", "points": "base/scan/points"}
    assert topics(read(rays(plugin(file="dummyfile")))) == one_row


def test_what_is_not_made_is_one_warning():
    found = read(rays(plugin(child(output_type="sensor_msgs/Vector3"))))
    assert found.sensors == found.problems == ()
    (warning,) = found.warnings
    assert warning.startswith('r:2: <gazebo> sensor "s" plugin "p": ')
    assert "sensor_msgs/LaserScan, sensor_msgs/PointCloud2, sensor_msgs/P" in warning


def test_each_plugin_of_a_sensor_publishes():
    kinds = dict(LaserScan="scan", PointCloud2="points", PointCloud="point_cloud", Range="range")
    plugins = [plugin(child(output_type="geometry_msgs/Vector3"), name="vector")]
    for kind, output in kinds.items():
        asked = child(output_type=f"sensor_msgs/{kind}", frame_name="a")
        renamed = ros(f"~/out:={output}", namespace="/ray")
        plugins.append(plugin(renamed + asked, name=output))
    found = read(rays(*plugins))
    assert topics(found) == {output: f"ray/{output}" for output in kinds.values()}
    assert len(found.warnings) == 1 and {each.name for each in found.sensors} == {"s"}
    listed = describe(found)
    for kind, output in kinds.items():
        assert re.search(rf"ray/{output} +sensor_msgs/msg/{kind} ", listed)


def test_two_plugins_on_one_topic_are_a_fault():
    same = [plugin(ros("~/out:=scan"), name=f"p{n}") for n in range(2)]
    found = read(rays(*same))
    assert found.sensors == () and "as does another plugin of it" in found.problems[0]


# Limits -------------------------------------------------------------------------------------------


def test_ranges_are_within_the_limits_of_the_plugin_and_have_its_noise():
    noise = "<noise><type>gaussian</type><stddev>0.03</stddev></noise>"
    limits = child(topicName="/points", min_range=0.9, max_range=130, gaussianNoise=0.04)
    (sensor,) = read(rays(noise, plugin(limits, "libgazebo_ros_velodyne_laser.so"), rows=2)).sensors
    assert sensor.topics == {"points": "/points"}
    assert (sensor.model.range_min, sensor.model.range_max) == (0.9, 10.0)  # of both the narrower
    assert sensor.model.noise == Noise(stddev=pytest.approx(0.05))  # of two sources
    limits = ros("~/out:=c") + child(max_range=5, gaussian_noise=0.1, organize_cloud="False")
    (sensor,) = read(rays(plugin(limits, "libgazebo_ros_velodyne_gpu_laser.so"))).sensors
    assert (sensor.model.range_min, sensor.model.range_max) == (0.1, 5.0)
    assert sensor.model.noise.stddev == 0.1 and not sensor.model.is_organized


def test_a_plugin_may_give_an_imu_noise():
    inside = plugin(child(topicName="imu", gaussianNoise=0.2), "libgazebo_ros_imu_sensor.so")
    (sensor,) = read(block(kind="imu", inside=inside)).sensors
    assert {*sensor.model.angular_velocity, *sensor.model.linear_acceleration} == {Noise(0.0, 0.2)}


@pytest.mark.parametrize(
    ("inside", "expected"),
    [
        ("", (0.1, 8.0, math.inf)),
        (child(min_depth=0.3, max_depth=1.5), (0.3, 1.5, math.nan)),
        (child(max_depth=100), (0.1, 8.0, math.nan)),
        (child(pointCloudCutoff=0.5, pointCloudCutoffMax=3), (0.5, 3.0, math.nan)),
        (child(pointCloudCutoffMax=3), (0.1, 3.0, math.nan)),
    ],
)
def test_depths_are_within_the_limits_of_the_plugin(inside, expected):
    clip = "<clip><near>0.1</near><far>8</far></clip>"
    (sensor,) = read(camera(clip, kind="depth", plugin=plugin(inside, CLASSIC))).sensors
    model = sensor.model
    assert (model.near, model.far) == (0.1, 8.0)  # pictures show what is farther, too
    assert (model.depth_near, model.depth_far, model.blank) == pytest.approx(expected, nan_ok=True)


@pytest.mark.parametrize(
    ("inside", "fault"),
    [
        (child(min_range=20), "<min_range> leave nothing of 0.1 to 10 m"),
        (child(min_range=3, max_range=2), "<min_range> and <max_range> leave nothing of"),
        (child(max_range="far"), '<max_range>: "far" is not a finite number'),
        (child(gaussianNoise=-1), "<gaussianNoise>: -1 is below 0"),
    ],
)
def test_limits_that_cannot_be_are_a_fault(inside, fault):
    found = read(rays(plugin(inside, "libgazebo_ros_velodyne_laser.so")))
    assert found.sensors == () and fault in found.problems[0]


@pytest.mark.parametrize(
    ("inside", "file", "radiation", "cone"),
    [
        ("", "libgazebo_ros_ray_sensor.so", "infrared", 6.0),
        (child(radiation_type="ultrasound"), "libgazebo_ros_ray_sensor.so", "ultrasound", 6.0),
        (child(radiationType="infrared"), "libgazebo_ros_ray_sensor.so", "infrared", 6.0),
        ("", "libgazebo_ros_range.so", "ultrasound", 6.0),
        (child(radiation="infrared", fov=0.05), "libgazebo_ros_range.so", "infrared", 0.05),
    ],
)
def test_a_range_has_a_field_of_view_and_a_radiation(inside, file, radiation, cone):
    found = read(rays(plugin(child(output_type="sensor_msgs/Range") + inside, file)))
    (sensor,) = found.sensors
    assert (sensor.model.radiation, sensor.model.field_of_view) == (radiation, cone)
    assert found.notices == ()


# What nothing reads -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("inside", "warning"),
    [
        (child(alwaysOn=1, visualize="true", updateRate=5, min_intensity=0.0), ""),
        (child(frame_name="a", distortion_k1=0.0, Cx=0), ""),
        (child(Cx=320.5, baseline=0.2), "<Cx>, <baseline>: not used by the sensor"),
        ("<scan><a/></scan>", "<scan>: not used"),
        ("<ros><qos/><parameter>5</parameter></ros>", "<parameter>: not used"),
    ],
)
def test_a_plugin_s_children_that_nothing_reads_are_one_warning(inside, warning):
    found = read(rays(plugin(inside + child(output_type="sensor_msgs/Range"))))
    assert len(found.sensors) == 1 and len(found.notices) == bool(warning)
    start = 'r:2: <gazebo> sensor "s" plugin "p": '
    assert all(text.startswith(start) and warning in text for text in found.notices)


def test_a_remapping_of_no_topic_is_a_warning():
    found = read(rays(plugin(ros("~/out:=scan", "~/in:=x"))))
    (warning,) = found.warnings
    assert "~/in:=x" in warning and "~/out:=scan" not in warning
    found = read(rays(plugin(ros("out:=scan"))))  # of another topic than ~/out
    assert topics(found) == {"points": "p/out"} and "out:=scan" in found.warnings[0]


def located(tag: str) -> str:
    return child(**{tag: "a"})


def gazebo(inside: str, link: str = "") -> str:
    return f'<gazebo reference="{link}">{inside}</gazebo>' if link else child(gazebo=inside)


REALSENSE = "librealsense_gazebo_plugin.so"


@pytest.mark.parametrize(
    ("written", "link", "kind"),
    [
        (gazebo(plugin(located("bodyName"), "libgazebo_ros_imu.so")), "a", "imu"),
        (gazebo(plugin(located("link"), REALSENSE)), "a", "rgbd_camera"),
        (gazebo(plugin("", REALSENSE)), "LINK", "rgbd_camera"),
        (gazebo(plugin("", "libgazebo_ros_velodyne_laser.so"), "a"), "a", "gpu_lidar"),
        (gazebo(child(x=plugin("", "libgazebo_ros_laser.so"))), "LINK", "gpu_lidar"),
        (gazebo(plugin(plugin(located("body_name"), SONAR), "q")), "a", "ray"),
        (gazebo(child(link=plugin("", CLASSIC)), "a"), "a", "camera"),
        (plugin(located("bodyName"), "libgazebo_ros_openni_kinect.so"), "a", "rgbd_camera"),
    ],
)
def test_a_plugin_outside_of_a_sensor_is_one_warning_with_the_block_to_write(written, link, kind):
    found = read(written)
    assert found.sensors == () and found.problems == ()
    (warning,) = found.warnings
    assert warning.startswith("r:2: ") and "without a <sensor>, so it is ignored" in warning
    proposed = warning.partition("; write ")[2]
    assert f'<gazebo reference="{link}">' in proposed and f' type="{kind}">' in proposed
    (sensor,) = (mended := read(proposed.replace("LINK", "a"))).sensors
    assert mended.notices == () and sensor.link == "a"


@pytest.mark.parametrize(
    ("file", "words"),
    [
        (
            "libgazebo_ros_p3d.so",
            "velocity_controller publishes the true pose and twist on ~/ground_truth",
        ),
        (
            "libhector_gazebo_ros_gps.so",
            '<gazebo reference="a"><sensor name="NAME" type="TYPE"/></gazebo>, with TYPE one of: '
            "rgbd_camera, imu",
        ),
    ],
)
def test_any_other_plugin_on_a_link_is_one_warning(file, words):
    (warning,) = read(f"<gazebo>{plugin(located('bodyName'), file)}</gazebo>").warnings
    assert 'on link "a" without a <sensor>' in warning and words in warning


def test_plugins_that_are_no_sensors_are_not_mentioned():
    for file in ("libgazebo_ros_diff_drive.so", "gz-sim-imu-system", "libsimulation_helper.so"):
        assert read(f"<gazebo>{plugin(child(update_rate=30), file, 'q')}</gazebo>").notices == ()


LIDAR = f'<sensor name="s" type="ray">{RAY.format(**VALUES)}</sensor>'


@pytest.mark.parametrize(
    ("written", "link"),
    [
        (f'<link name="b"><gazebo>{LIDAR}</gazebo></link>', "b"),
        (f'<link name="b"><gazebo reference="a">{LIDAR}</gazebo></link>', "a"),
        (LIDAR, "LINK"),
        (f'<gazebo reference="a"><x>{LIDAR}</x></gazebo>', "a"),
    ],
)
def test_a_sensor_in_the_wrong_place_is_one_warning_that_says_where_it_belongs(written, link):
    joint = '<joint name="j" type="fixed"><parent link="a"/><child link="b"/></joint>'
    found = read(written, joint if 'name="b"' in written else "")
    assert found.sensors == () and found.problems == ()
    (warning,) = found.warnings
    assert warning.startswith("r:2: ") and 'sensor "s": is ' in warning
    assert f'write <gazebo reference="{link}"> around it, directly in <robot>' in warning


def test_sensors_of_ros2_control_are_no_blocks():
    control = '<ros2_control name="c" type="sensor"><sensor name="imu"/></ros2_control>'
    assert parse_description(f'<robot name="r"><link name="a"/>{control}</robot>').notices == ()
