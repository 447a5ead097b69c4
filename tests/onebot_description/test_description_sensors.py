"""Sensors: the blocks of public robots as they are written, and faults with line and remedy."""

import math
from pathlib import Path

import pytest

from onebot_description.description import DescriptionError, describe, load_description
from onebot_description.description.loading import load_sensors, parse_description
from onebot_description.description.sensors.camera import Camera
from onebot_description.description.sensors.imu import Imu
from onebot_description.description.sensors.lidar import Fan, Lidar
from onebot_description.description.sensors.noise import Noise
from onebot_description.geometry.poses import Origin
from tests.onebot_description.sensor_blocks import RAY, VALUES, block, camera, rays, read

BLOCKS = Path(__file__).parents[1] / "robots" / "sensors"

CAMERA = {
    "image": "camera/image_raw",
    "depth": "camera/depth/image_raw",
    "camera_info": "camera/camera_info",
    "points": "camera/points",
}
# Name, link, rate, frame and topics of each sensor.
OF_CAMERA = " ".join(f"{output}={topic}" for output, topic in CAMERA.items())
OF_DEPTH_PLUGIN = "depth_camera_info=camera/depth/camera_info"
OF_GZ = "image=camera/image depth=camera/depth_image camera_info=camera/camera_info"
OF_GZ += " points=camera/points"
PUBLIC_ROBOTS = {
    "turtlebot3_waffle_pi": """
        imu imu_link 0 imu_link imu=imu
        lds base_scan 5 base_scan scan=scan
        Pi_Camera camera_rgb_frame 30 camera_rgb_optical_frame image=camera/rgb/image_raw
            camera_info=camera/rgb/camera_info""",
    "turtlebot4": f"""
        rplidar rplidar_link 62 rplidar_link scan=scan points=scan/points
        rgbd_camera oakd_rgb_camera_frame 30 oakd_rgb_camera_frame {OF_CAMERA}
        imu imu_link 62 imu_link imu=imu
        cliff_side_left cliff_side_left 62 cliff_side_left scan=cliff_side_left/scan
            points=cliff_side_left/scan/points
        ir_intensity_left ir_intensity_left 62 ir_intensity_left points=points
            scan=ir_intensity_left/scan""",
    "create3": """
        cliff_front_left cliff_front_left 62 cliff_front_left scan=scan points=scan/points
        cliff_front_right cliff_front_right 62 cliff_front_right
            scan=_internal/cliff_front_right/event
        bumper_contact_sensor bumper 62 bumper contacts=contacts""",
    "husky": f"""
        front_laser base_laser 50 base_laser scan=front/scan
        camera camera_link 20 camera_frame_optical image=camera/rgb/image_raw
            depth=camera/depth/image_raw camera_info=camera/rgb/camera_info
            points=camera/depth/points {OF_DEPTH_PLUGIN}""",
    "linorobot2": f"""
        laser laser 10 laser scan=scan points=scan/points
        imu_sensor imu_link 20 imu_link imu=imu/data
        camera camera_link 30 camera_color_optical_frame {OF_GZ}""",
    "rosbot": f"""
        fl_range fl_range 5 fl_range scan=range/fl points=range/fl/points
        imu imu_link 25 imu_link imu=imu/data_raw
        camera_orbbec_astra_camera camera_orbbec_astra_link 20 camera_depth_optical_frame
            {OF_GZ}""",
    "clearpath": """
        lidar3d_0 lidar3d_0_laser 10 lidar3d_0_laser
            points=a200_0000/sensors/lidar3d_0/scan/points
            scan=a200_0000/sensors/lidar3d_0/scan
        camera_0 camera_0_link 30 camera_0_color_optical_frame
            image=a200_0000/sensors/camera_0/color/image
            camera_info=a200_0000/sensors/camera_0/color/camera_info
        imu_0 imu_0_link 50 imu_0_link imu=a200_0000/sensors/imu_0/data_raw""",
}


@pytest.mark.parametrize(("robot", "expected"), PUBLIC_ROBOTS.items())
def test_sensors_of_public_robots(robot, expected):
    found = load_description(BLOCKS / f"{robot}.urdf")
    assert found.problems == () and found.bad_sensors == ()
    words = []
    for sensor in found.sensors:
        words += [sensor.name.replace(" ", "_"), sensor.link, f"{sensor.rate:g}", sensor.frame]
        words += [f"{output}={topic}" for output, topic in sensor.topics.items()]
    assert words == expected.split()
    assert all(sensor.where.split(":")[-1].isdigit() for sensor in found.sensors)


def test_models_of_public_robots():
    def model(robot, name):
        sensors = load_description(BLOCKS / f"{robot}.urdf").sensors
        return next(sensor.model for sensor in sensors if sensor.name == name)

    turn = Fan(360, 0.0, 6.28319)
    assert model("turtlebot3_waffle_pi", "lds") == Lidar(turn, Fan(), 0.12, 3.5, Noise(stddev=0.01))
    assert model("turtlebot3_waffle_pi", "Pi Camera") == Camera(
        1.085595, 640, 480, 0.03, 100.0, 0.03, 100.0
    )
    assert model("andino", "camera").baseline == 0.07
    assert model("create3", "cliff_front_left").noise.stddev == 0.01  # written beside the <ray>
    assert model("rosbot", "fl_range") == Lidar(Fan(), Fan(), 0.01, 0.9)
    assert model("rosbot", "camera_orbbec_astra_camera").near == 0.6  # without a <camera>
    velodyne = model("clearpath", "lidar3d_0")
    assert velodyne.vertical == Fan(16, -0.261799, 0.261799)
    x, y = Noise(0.0, 2e-4, 0.0000075, 0.0000008), Noise(stddev=3e-4)
    assert model("linorobot2", "imu_sensor") == Imu(
        (x, y, Noise()), (Noise(), Noise(), Noise(stddev=1.7e-2))
    )


def test_what_is_not_simulated_is_one_warning():
    for robot in ("andino", "linorobot2_classic", "articubot_one", "turtlebot4", "create3"):
        assert load_description(BLOCKS / f"{robot}.urdf").notices == ()
    sonar = '<gazebo reference="base"><sensor name="s" type="sonar"/></gazebo>'
    (sound,) = parse_description(f'<robot name="r"><link name="base"/>{sonar}</robot>').warnings
    assert 'sensor "s": sensors of type "sonar" are not simulated' in sound
    lens, frame = load_description(BLOCKS / "clearpath.urdf").warnings
    assert "<lens>: is not simulated" in lens
    assert 'no link is called "camera_0_color_optical_frame"' in frame


def test_check_lists_the_sensors():
    text = describe(load_description(BLOCKS / "linorobot2.urdf"))
    heading, laser, points, imu, camera, *others = text.splitlines()[-8:]
    assert heading.split() == ["sensor", "measures", "rate", "topic", "type", "frame"]
    scan = ["scan", "sensor_msgs/msg/LaserScan", "laser"]
    assert laser.split() == ["laser", "360", "ranges", "to", "12", "m", "10", "Hz", *scan]
    assert points.split() == ["scan/points", "sensor_msgs/msg/PointCloud2"]
    assert imu.split()[-5:] == ["20", "Hz", "imu/data", "sensor_msgs/msg/Imu", "imu_link"]
    picture = ["camera/image", "sensor_msgs/msg/Image", "camera_color_optical_frame"]
    assert camera.split()[-3:] == picture
    assert [each.split() for each in others] == [
        ["camera/depth_image", "sensor_msgs/msg/Image"],
        ["camera/camera_info", "sensor_msgs/msg/CameraInfo"],
        ["camera/points", "sensor_msgs/msg/PointCloud2"],
    ]
    assert "sensor" not in describe(parse_description('<robot name="r"><link name="a"/></robot>'))


@pytest.mark.parametrize(
    ("written", "fault"),
    [
        (block(samples=0), "<samples>: 0 is below 1; write a number from 1 to 300000"),
        (block(samples="12.5"), "<samples>: 12.5 is not a whole number"),
        (block(near=12), "<range>: <min> 12 is not below <max> 10; swap or change them"),
        (block(low=3, high=-3), "<min_angle> 3 is not below <max_angle> -3"),
        (block(high=4.2), "more than a turn"),
        (block(far="nan"), '<max>: "nan" is not a finite number'),
        (block(inside=RAY.replace("max>", "most>").format(**VALUES)), "has no <range/max>"),
        (block(rate="1e6"), "<update_rate>: 1e+06 is above 1000; write a number from 0 to 1000"),
        (block(link="b"), 'there is no link "b" (links: a)'),
        (block(link=""), 'is in no link; write <gazebo reference="LINK"> around it'),
        (block(name=""), 'has no name; write <sensor name="...">'),
        (rays("<topic>2d/scan</topic>"), 'topic "2d/scan" is not'),
        (rays("<pose>1 2</pose>"), "<pose>: holds 2 numbers; write"),
        (rays('<pose relative_to="b"/>'), '<pose>: there is no frame "b" (links and joints: a)'),
        (rays("<noise><type>pink</type></noise>"), 'type "pink"'),
        (camera(fov=0), "<horizontal_fov>: 0 is below 0.01; write a number from 0.01 to 3"),
        (camera(width=7680, height=4320), "7680 x 4320 pixels are more than 2304000 (1920 x 1200)"),
        (camera("<clip><near>2</near><far>1</far></clip>"), "<near> 2 is not below <far> 1"),
    ],
)
def test_a_fault_leaves_the_sensor_out(written, fault):
    found = read(written)
    assert found.sensors == ()
    (problem,) = found.problems
    assert problem.startswith("r:2: <gazebo> ") and fault in problem


def test_all_faults_at_once_and_the_other_sensors_stay():
    on_scan = RAY.format(**VALUES) + "<topic>/scan</topic>"
    found = read(
        block("good", inside=on_scan),
        block("bad", samples=0, far="nan", near=-1),
        block("twin", kind="gpu_lidar", inside=on_scan.replace("ray", "lidar")),
        camera(kind="rgbd_camera"),
    )
    assert [sensor.name for sensor in found.sensors] == ["good", "s"]
    assert found.bad_sensors == ("bad", "twin")
    *bad, twin = found.problems
    assert len(bad) == 3 and all(each.startswith('r:3: <gazebo> sensor "bad"') for each in bad)
    assert twin.endswith(
        'sensor "twin": publishes "scan", as does the one at r:2; give it its own <topic>'
    )


def test_a_misspelt_element_is_a_warning():
    (warning,) = read(rays("<updaterate>5</updaterate>")).warnings
    assert "<updaterate>: is not simulated inside <sensor>" in warning
    assert 'did you mean "update_rate"?' in warning


def test_poses_are_in_the_frame_of_the_link():
    pose = '<pose degrees="true">1 2 3 90 0 0</pose>'
    (sensor,) = read(rays(pose)).sensors
    assert sensor.origin == Origin((1, 2, 3), (pytest.approx(1.5707963), 0, 0))


FRAMES = (
    '<link name="laser"/><joint name="mount" type="fixed"><parent link="a"/><child link="laser"/>'
    '<origin xyz="0.1 0 0.2" rpy="0 0 1.5707963267948966"/></joint><link name="arm"/>'
    '<joint name="elbow" type="revolute"><parent link="laser"/><child link="arm"/>'
    '<origin xyz="1 0 0"/><axis xyz="0 0 1"/><limit lower="-1" upper="1" effort="1" velocity="1"/>'
    "</joint>"
)


@pytest.mark.parametrize(
    ("link", "frame", "xyz", "yaw"),
    [
        ("laser", "a", (0.0, -0.2, -0.2), -math.pi / 2),
        ("laser", "", (0.3, 0, 0), 0.0),
        ("a", "laser", (0.1, 0.3, 0.2), math.pi / 2),
        ("a", "mount", (0.1, 0.3, 0.2), math.pi / 2),  # a joint's frame is that of its child
        ("a", "arm", (0.1, 1.3, 0.2), math.pi / 2),  # while what moves between them is at 0
        ("arm", "__model__", (-1.0, -0.2, -0.2), -math.pi / 2),
        ("laser", "r::a", (0.0, -0.2, -0.2), -math.pi / 2),
    ],
)
def test_a_pose_is_relative_to_the_frame_that_it_names(link, frame, xyz, yaw):
    pose = f'<pose relative_to="{frame}">0.3 0 0 0 0 0</pose>'
    (sensor,) = read(block(inside=RAY.format(**VALUES) + pose, link=link), FRAMES).sensors
    assert sensor.origin.xyz == pytest.approx(xyz, abs=1e-9)
    assert sensor.origin.rpy == pytest.approx((0, 0, yaw), abs=1e-9)


@pytest.mark.parametrize(
    ("axes", "rpy", "at_start"),
    [
        ("<localization>ENU</localization>", (0, 0, 0), False),
        ("<localization> NED </localization>", (math.pi, 0, math.pi / 2), False),
        ("<localization>NWU</localization>", (0, 0, math.pi / 2), False),
        ("<localization>CUSTOM</localization>", (0, 0, 0.5), True),  # the sensor's own at first
        ('<custom_rpy parent_frame="world">0.1 0.2 0.3</custom_rpy>', (0.1, 0.2, 0.3), False),
        ("<custom_rpy>0 0 0.3</custom_rpy>", (0, 0, 0.8), True),
        ('<custom_rpy parent_frame="laser">0 0 0.3</custom_rpy>', (0, 0, math.pi / 2 + 0.3), True),
    ],
)
def test_an_imu_has_the_axes_that_its_block_names(axes, rpy, at_start):
    frame = f"<orientation_reference_frame>{axes}</orientation_reference_frame>"
    inside = f"<pose>0 0 0 0 0 0.5</pose><imu>{frame}</imu>"
    found = read(block(kind="imu", inside=inside), FRAMES)
    (sensor,) = found.sensors
    assert sensor.model.reference.rpy == pytest.approx(rpy, abs=1e-9)
    assert sensor.model.reference.at_start == at_start


@pytest.mark.parametrize(
    ("axes", "text"),
    [
        ("<localization>NEDD</localization>", 'did you mean "NED"?'),
        ('<custom_rpy parent_frame="lasser">0 0 0</custom_rpy>', 'did you mean "laser"?'),
        ("<custom_rpy>0 0</custom_rpy>", "holds 2 numbers; write roll pitch yaw"),
    ],
)
def test_axes_that_an_imu_cannot_have_are_reported(axes, text):
    frame = f"<orientation_reference_frame>{axes}</orientation_reference_frame>"
    found = read(block(kind="imu", inside=f"<imu>{frame}</imu>"), FRAMES)
    assert any(text in each for each in found.notices), found.notices


def test_an_imu_may_have_no_orientation():
    for text in ("false", "0", " False ", "true", "1", "True"):
        inside = f"<imu><enable_orientation>{text}</enable_orientation></imu>"
        (sensor,) = read(block(kind="imu", inside=inside)).sensors
        assert (sensor.model.reference is None) == (text in ("false", "0", " False "))


def test_a_file_gives_sensors_to_a_robot_that_lacks_them(tmp_path):
    file = tmp_path / "sensors.urdf.xacro"
    sensor = block(rate="${2 * 5}", link="base_scan")
    file.write_text(
        f'<robot xmlns:xacro="http://www.ros.org/wiki/xacro">\n{sensor}\n{block("t", link="b")}\n'
        "</robot>"
    )
    robot = parse_description('<robot name="r"><link name="base_scan"/></robot>')
    found = load_sensors(file, robot)
    assert [(each.name, each.rate) for each in found.sensors] == [("s", 10.0)]
    assert found.files == (file,) and found.bad_sensors == ("t",)
    assert "sensors.urdf.xacro:3: " in found.notices[0] and 'no link "b"' in found.notices[0]
    file.write_text("<robot/>")
    with pytest.raises(DescriptionError, match="holds no sensor; write <robot><gazebo"):
        load_sensors(file, robot)


def test_the_block_in_the_readme_is_read_without_a_warning(tmp_path):
    text = (Path(__file__).parents[2] / "onebot_control/docs/sensors.md").read_text()
    (tmp_path / "own.urdf").write_text(text.partition("```xml\n")[2].partition("```")[0])
    robot = parse_description('<robot name="r"><link name="base_scan"/></robot>')
    (sensor,) = (found := load_sensors(tmp_path / "own.urdf", robot)).sensors
    assert (
        found.notices == ()
        and sensor.topics == {"scan": "scan", "points": "scan/points"}
        and sensor.model.noise.stddev == 0.005
    )


@pytest.mark.parametrize("prefix", ["", "left_"])
def test_onebot_has_sensors_if_asked_for(prefix):
    """Else it is the robot that it was, link for link."""
    file = Path(__file__).parents[2] / "onebot_description/urdf/onebot.urdf.xacro"
    plain = load_description(file, {"prefix": prefix})
    sensing = load_description(file, {"prefix": prefix, "sensors_enabled": "true"})
    assert plain.sensors == () and sensing.notices == ()
    assert sensing.links[: len(plain.links)] == plain.links
    assert sensing.joints[: len(plain.joints)] == plain.joints
    frames = [f"{prefix}{name}" for name in ("lidar_link", "imu_link", "camera_optical_frame")]
    assert [sensor.frame for sensor in sensing.sensors] == frames
    assert [sensor.topics for sensor in sensing.sensors] == [
        {"scan": "scan", "points": "scan/points"},
        {"imu": "imu"},
        CAMERA,
    ]
    assert "gazebo" not in plain.urdf


def test_contact_sensors() -> None:
    """The topic may be in <contact>; without one, several have their names before it."""
    inside = "<contact><collision>c</collision>{}</contact>"
    blocks = "".join(
        f'<gazebo reference="base_link"><sensor name="{name}" type="contact">'
        f"<update_rate>62</update_rate>{inside.format(topic)}</sensor></gazebo>"
        for name, topic in (
            ("front", "<topic>/bumped</topic>"),
            ("left", ""),
            ("right", "<topic>__default_topic__</topic>"),
        )
    )
    description = parse_description(f'<robot name="r"><link name="base_link"/>{blocks}</robot>')
    assert description.notices == ()
    assert [sensor.topics["contacts"] for sensor in description.sensors] == [
        "bumped", "left/contacts", "right/contacts",
    ]  # fmt: skip
    assert {sensor.rate for sensor in description.sensors} == {62.0}
    assert description.sensors[0].model.summary == "contacts of its link"
