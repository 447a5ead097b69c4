"""Sensors against the bare calls of Embree with the same rays, and what they cost the control loop.

Ranges and depths are checked against the bare call's. The control loop's jitter is measured as by
``control_loop``: with OneBot's lidar, IMU and camera subscribed to, and without subscribers. Then
20 robots, each with a lidar, drive among walls in real time.
"""

import math
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np

from onebot_control.control_loop import ControlLoop
from onebot_control.driven_robot import Snapshot
from onebot_control.fleet import Fleet, Member
from onebot_control.parameters import ControlConfig
from onebot_control.sensing import camera, lidar
from onebot_control.sensing.instruments import Instrument, Sensing
from onebot_control.sensing.rays import NOTHING, cast
from onebot_control.sensing.surroundings import Placed, RobotState, SensedRobot, Surroundings
from onebot_description.description import Description, load_description, parse_description
from onebot_description.description.description import Camera, Fan, Lidar
from tests.benchmarks.control_loop import Effort, Window, _measured
from tests.benchmarks.measuring import Running, WrongAnswer, in_turn, median, percentile, ros_domain
from tests.benchmarks.report import Options, Report, Value, at_least, at_most

MODEL = "package://onebot_description/urdf/onebot.urdf.xacro"
ALONE, SUBSCRIBED = "controller, no subscriber", "controller, scan and camera subscribed"
_ROBOTS, _ROWS, _APART = 20, 5, 1.2  # m
_SLICE = 0.1  # s of processor time
# Subscribes to what is given, until it is stopped.
_LISTENER = """
import sys, rclpy
from sensor_msgs.msg import Image, LaserScan
rclpy.init()
node = rclpy.create_node("listener")
images = "camera/image_raw", "camera/depth/image_raw"
for kind, topic in ((LaserScan, "scan"), *((Image, name) for name in images)):
    node.create_subscription(kind, topic, lambda data: None, 10, raw=True)
try:
    rclpy.spin(node)
except KeyboardInterrupt:
    pass
"""


def run(options: Options) -> Report:
    """Measure all three."""
    options.say("sensing: rays against bare calls")
    ratios = _ratios(options)
    options.say("sensing: jitter of the control loop")
    windows = _jitter(options)
    options.say(f"sensing: {_ROBOTS} robots")
    pace, share, costs = _fleet(4.0 if options.quick else 20.0)
    jitters = {name: _p99(each) for name, each in windows.items()}
    goals = [
        at_most("360 ranges: CPU over the bare call", ratios["scan"], 3.0),
        at_most(
            "picture of 320 x 240, colour and depth: CPU over the bare call", ratios["picture"], 1.5
        ),
        at_most("p99 jitter, subscribed over not", jitters[SUBSCRIBED] / jitters[ALONE], 1.5),
        at_most("p99 jitter, subscribed", jitters[SUBSCRIBED], 1000.0, "us"),
        at_least(f"{_ROBOTS} robots with lidars: of real time at 100 Hz", pace, 0.99),
        at_least(f"{_ROBOTS} robots with lidars: scans of those due", share, 0.99),
    ]
    rows: list[dict[str, Value]] = [
        {
            "Loop": name,
            "jitter p50 us": median([percentile(each.late_us, 50) for each in some]),
            "jitter p99 us": jitters[name],
            "CPU us/cycle": median([each.cpu_us for each in some]),
        }
        for name, some in windows.items()
    ]
    notes = [
        "Rays: in a world of 50 boxes, with one OneBot. Robots: without ROS, in one process; CPU s "
        + "per simulated s: "
        + ", ".join(f"{cost:.3f} of thread {name}" for name, cost in costs.items())
    ]
    return Report("sensing", rows, goals, notes)


def _p99(windows: Sequence[Window]) -> float:
    return median([percentile(window.late_us, 99) for window in windows])


# Rays ------------------------------------------------------------------------------------------


def _boxes() -> Description:
    rng = np.random.default_rng(50)
    visuals = []
    for number in range(50):
        around, away = number * math.tau / 50, rng.uniform(1.5, 8.0)
        xyz = f"{away * math.cos(around):.3f} {away * math.sin(around):.3f} 0.2"
        visuals.append(
            f'<visual><origin xyz="{xyz}" rpy="0 0 {number}"/><geometry><box size="0.4 0.3 0.5"/>'
            "</geometry></visual>"
        )
    return parse_description(
        f'<robot name="w"><link name="world">{"".join(visuals)}</link></robot>'
    )


def _ratios(options: Options) -> dict[str, float]:
    """CPU of a scan and of a picture over that of the bare calls."""
    onebot = load_description(MODEL, {"sensors_enabled": "true"})
    robot = SensedRobot(onebot, [joint.name for joint in onebot.moving_joints], {})
    scene = Surroundings(_boxes(), [robot])
    at = RobotState(np.array([0, 0, 0.06]), np.array([0, 0, 0, 1.0]), np.zeros(len(robot.joints)))
    placed = Placed(scene, [], [at])
    targets = placed.targets
    base, eye = (scene.target(0, link) for link in ("base_link", "camera_link"))
    ranger = Lidar(Fan(360, -math.pi, math.pi * 179 / 180), Fan(), 0.05, 12.0)
    lens = Camera(1.2, 320, 240, 0.05, 50.0, 0.05, 8.0)
    painter = camera.Painter(scene.still)
    turn, (place, face) = np.eye(3), _places(placed)
    fan, pixels = lidar.lidar_rays(ranger), camera.camera_rays(lens)

    def scan() -> Any:
        hits = cast(fan, turn, place, scene.still, targets, lidar.reach(ranger), base)
        return lidar.ranges(ranger, hits.distances, hits.surfaces != NOTHING)

    def picture() -> Any:
        hits = cast(pixels, turn, face, scene.still, targets, camera.reach(lens), eye)
        return painter.picture(lens, pixels, face, hits, targets), camera.depths(lens, hits)

    def bare(rays: Any, origin: Any) -> Callable[[], Any]:
        origins = np.broadcast_to(origin.astype(np.float32), rays.singles.shape).copy()
        caster = scene.still._caster
        return lambda: caster.run(origins, rays.singles, output=True)  # type: ignore

    found, true = scan(), bare(fan, place)()["tfar"]
    both = true < 12.0
    if not both.any() or np.abs(found - true)[both].max() > 1e-4:
        raise WrongAnswer("the ranges are not those of the bare call")
    variants = {
        "scan": scan,
        "bare scan": bare(fan, place),
        "picture": picture,
        "bare picture": bare(pixels, face),
    }
    slices = {name: (lambda each=each: _cpu(each)) for name, each in variants.items()}
    took = in_turn(slices, options.choose(15, 1))
    return {name: median(took[name]) / median(took[f"bare {name}"]) for name in ("scan", "picture")}


def _places(placed: Placed) -> Sequence[Any]:
    """Positions of OneBot's lidar and camera."""
    links = [placed.link(0, name) for name in ("lidar_link", "camera_link")]
    return [link.position for link in links if link is not None]


def _cpu(function: Callable[[], object]) -> float:
    """Processor time of this thread for a call, s."""
    function()
    count, began = 0, time.thread_time()
    while time.thread_time() - began < _SLICE:
        function()
        count += 1
    return (time.thread_time() - began) / count


# The control loop ------------------------------------------------------------------------------


def _jitter(options: Options) -> Mapping[str, list[Window]]:
    effort = Effort(1.0, 1.0) if options.quick else Effort(6.0, 0.02)
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "onebot.urdf"
        file.write_text(load_description(MODEL, {"sensors_enabled": "true"}).urdf)
        variants = {
            ALONE: lambda: _window(file, effort, subscribed=False),
            SUBSCRIBED: lambda: _window(file, effort, subscribed=True),
        }
        return in_turn(variants, options.choose(7, 1))


def _window(file: Path, effort: Effort, *, subscribed: bool) -> Window:
    with ExitStack() as stack:
        environment = stack.enter_context(ros_domain())
        environment["OPENBLAS_NUM_THREADS"] = "1"  # as a bringup has it
        if subscribed:
            stack.enter_context(Running([sys.executable, "-c", _LISTENER], environment))
        words = [str(file), "--ros-args", "-p", "world:=maze"]
        return _measured(stack, "timed_controller", words, environment, effort)[0]


# A fleet ---------------------------------------------------------------------------------------


class _Count:
    """Wants scans, and counts them."""

    def __init__(self) -> None:
        self.scans = 0

    def wanted(self) -> frozenset[str]:
        return frozenset({"scan"})

    def publish(self, stamp: int, outputs: Mapping[str, Any]) -> None:
        if not np.isfinite(outputs["scan"]).any():
            raise WrongAnswer("a robot among walls sees none")
        self.scans += 1


def _walls() -> Description:
    """Walls between the places of the robots."""
    shapes = "".join(
        f'<origin xyz="{-row * _APART:g} {-column * _APART + _APART / 2:g} 0.125"/><geometry>'
        f'<box size="{_APART / 2:g} 0.04 0.25"/></geometry></X><X>'
        for row in range(_ROBOTS // _ROWS)
        for column in range(_ROWS + 1)
    ).removesuffix("</X><X>")
    both = "".join(f"<X>{shapes}</X>".replace("X>", f"{kind}>") for kind in ("visual", "collision"))
    return parse_description(
        '<robot name="w"><link name="world"/><link name="walls">' + both + "</link>"
        '<joint name="j" type="fixed"><parent link="world"/><child link="walls"/></joint></robot>'
    )


def _cpu_of_threads() -> dict[str, float]:
    """Processor time of this process's threads by name, s."""
    times = {}
    for thread in threading.enumerate():
        task = Path(f"/proc/self/task/{thread.native_id}/schedstat")
        times[thread.name] = 1e-9 * int(task.read_text().split()[0])
    return times


def _fleet(seconds: float) -> tuple[float, float, dict[str, float]]:
    """Return simulated seconds a second, the share of the scans due, and what threads cost.

    The costs are processor time of the threads for each simulated second, by their names.
    """
    onebot, world = load_description(MODEL, {"sensors_enabled": "true"}), _walls()
    members = [
        Member(
            onebot,
            ControlConfig.from_parameters(
                {"x": -_APART * (row // _ROWS), "y": -_APART * (row % _ROWS)}
            ),
            f"robot{row}",
        )
        for row in range(_ROBOTS)
    ]
    fleet = Fleet.of(members, scene=world)
    failures: list[BaseException] = []
    sensing = Sensing(world, fleet.rate, 9.81, lambda text: None, failures.append)
    (sensor,) = (each for each in onebot.sensors if "scan" in each.topics)
    counts = [_Count() for _ in members]
    for row, (robot, count) in enumerate(zip(fleet.robots, counts, strict=True)):
        sensed = SensedRobot(robot.description, robot.plant.joints, robot.held)
        sensing.enter(row, sensed, [Instrument(sensor, row, str(row), count, fleet.rate)])

    def publish(snapshots: Sequence[Snapshot], stamp: int) -> None:
        sensing.due(snapshots[0].tick)
        sensing.take(stamp, snapshots, ())

    loop = ControlLoop(fleet, publish, simulated=True, failed=failures.append)
    sensing.start()
    loop.start()
    try:
        for robot in fleet.robots:
            loop.post(lambda robot=robot: robot.accept(0.0, 0.5))
        time.sleep(1.0)
        ticks, scans, began = fleet.ticks, sum(each.scans for each in counts), time.monotonic()
        before = _cpu_of_threads()
        time.sleep(seconds)
        ticks, took = fleet.ticks - ticks, time.monotonic() - began
        after = _cpu_of_threads()
        scans = sum(each.scans for each in counts) - scans
    finally:
        loop.stop()
        sensing.stop()
    if failures:
        raise WrongAnswer(str(failures[0]))
    simulated = ticks / fleet.rate
    costs = {name: (after[name] - before[name]) / simulated for name in ("control", "sensing")}
    return simulated / took, scans / (_ROBOTS * sensor.rate * simulated), costs
