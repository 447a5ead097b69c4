"""Makes the pictures of the documentation again, with the public commands.

``python -m tests.pictures [maze] [onebot] [mrm] [arm] [--into FOLDER]``: all
if none is named. They replace those in the documentation, or go into FOLDER, to be looked at.
"""

import argparse
import math
import re
import subprocess
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from PIL import Image, ImageDraw

from onebot_control import Simulation
from onebot_description.ros.domains import used_domain
from tests.readme import CHECKOUT
from tests.ros_support import NodeProcess
from tests.support import wait_for

PLACES = {
    "maze": CHECKOUT / "onebot_bringup/images/maze.gif",
    "onebot": CHECKOUT / "onebot_bringup/images/onebot.png",
    "mrm": CHECKOUT / "mrm_description/images/mrm.png",
    "arm": CHECKOUT / "mrm_description/images/arm.png",
}
# OneBot's commands for its picture: m/s, rad/s and s; an S-curve.
DRIVE = ((0.2, 0.5, 6.0), (0.35, -0.5, 6.0), (0.25, 0.45, 6.0))
# MRM's trajectory: to 0.9 rad in 4 s, and to -0.3 rad in another 5 s.
TRAJECTORY = """{joint_names: [base_link__link_01], points: [
  {positions: [0.9], velocities: [0.0], time_from_start: {sec: 4}},
  {positions: [-0.3], velocities: [0.0], time_from_start: {sec: 9}}]}"""
Point = tuple[float, float, float]
EYE, TARGET = (1.2, -0.9, 3.6), (1.2, 1.05, 0.0)  # of the moving picture, m
MOVING = (480, 360)
GOALS = ((2.4, 0.8), (0.0, 0.8), (0.0, 2.4), (0.8, 2.4))
RED, GREEN, BLUE = (230, 40, 40), (20, 170, 70), (60, 120, 220)
TOPIC = "/velocity_controller/cmd_vel"
ONEBOT, BRINGUP = "onebot_bringup.cli.main", "onebot_bringup.launch.onebot_bringup"
MRM = "mrm_description.launch.mrm_bringup"


def main(argv: Sequence[str] | None = None) -> int:
    """Make the requested pictures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", metavar="NAME", help=", ".join(PLACES))
    parser.add_argument("--into", type=Path, metavar="FOLDER")
    args = parser.parse_args(argv)
    unknown = set(args.names) - set(PLACES)
    if unknown:
        parser.error(f"no picture {', '.join(sorted(unknown))} (there: {', '.join(PLACES)})")
    for name in args.names or PLACES:
        picture = args.into.absolute() / PLACES[name].name if args.into else PLACES[name]
        with TemporaryDirectory() as folder, used_domain():  # no other robot in the picture
            _MAKERS[name](picture, Path(folder))
        print(f"{name}: {picture}")
    return 0


def make_maze(picture: Path, _: Path) -> None:
    """OneBot finds its way to several goals, with its scan, the path ahead and its trail."""
    project = _projection(EYE, TARGET, MOVING)
    frames, trail = list[Image.Image](), list[tuple[float, float, float]]()
    with Simulation(world="maze", sensors=True, seed=3) as simulation:
        robot = simulation.robot
        for x, y in GOALS:
            robot.go_to(x, y)
            while robot.navigating:
                simulation.run(0.25)
                pose, scan = robot.pose, robot.scan()
                trail.append((pose.x, pose.y, 0.02))
                colors = simulation.picture(EYE, TARGET, width=MOVING[0], height=MOVING[1])
                frames.append(Image.fromarray(colors))
                draw = ImageDraw.Draw(frames[-1])
                hit = np.isfinite(scan.ranges)
                angles, ranges = scan.angles[hit] + pose.yaw, scan.ranges[hit]
                ends = np.stack(
                    (pose.x + ranges * np.cos(angles), pose.y + ranges * np.sin(angles)), axis=1
                )
                for u, v in project(np.insert(ends, 2, 0.15, axis=1)):
                    draw.ellipse((u - 1.5, v - 1.5, u + 1.5, v + 1.5), fill=RED)
                for way, color in ((np.insert(robot.path, 2, 0.01, axis=1), GREEN), (trail, BLUE)):
                    if len(way) > 1:
                        draw.line([tuple(each) for each in project(way)], fill=color, width=3)
            assert robot.navigation.status == "arrived", robot.navigation.reason
    few = [frame.quantize(48, dither=Image.Dither.NONE) for frame in frames]
    few[0].save(picture, save_all=True, append_images=few[1:], duration=125, loop=0, optimize=True)


def _projection(eye: Point, target: Point, size: tuple[int, int]) -> Callable[[Any], Any]:
    """Return a function that projects points into ``Simulation.picture``, 1 rad wide."""
    ahead = np.subtract(target, eye) / math.dist(target, eye)
    right = np.cross(ahead, (0.0, 0.0, 1.0))
    right /= np.linalg.norm(right)
    focal = size[0] / (2.0 * math.tan(0.5))

    def project(points: Any) -> Any:
        away = np.asarray(points, float).reshape(-1, 3) - eye
        across = np.stack((away @ right, -away @ np.cross(right, ahead)), axis=1)
        return np.array(size) / 2.0 + focal * across / (away @ ahead)[:, None]

    return project


def make_onebot(picture: Path, folder: Path) -> None:
    """OneBot mid-drive, with its trails and its speeds."""
    rrd = folder / "onebot.rrd"
    with ExitStack() as drivers:  # the last command lasts until the robot has ended
        with running(BRINGUP, "viewer:=none", f"save:={rrd}", ready="driving robot"):
            drive(drivers, DRIVE)
    snapshot(picture, rrd)


def make_mrm(picture: Path, folder: Path) -> None:
    """MRM turning, with the plot of its joint over most of a swing."""
    rrd = folder / "mrm.rrd"
    with running(MRM, "viewer:=none", f"save:={rrd}", ready="showing"):
        time.sleep(17.0)
    snapshot(picture, rrd)


def make_arm(picture: Path, folder: Path) -> None:
    """MRM on a trajectory, with the plot of its reference and its measured position."""
    rrd = folder / "arm.rrd"
    with running(MRM, "sim:=true", "viewer:=none", f"save:={rrd}", ready="moving robot"):
        topic, kind = "/joint_trajectory_controller/joint_trajectory", "trajectory_msgs/msg/"
        publish = [sys.executable, "-m", ONEBOT, "topic", "pub", "--once", topic]
        command = [*publish, f"{kind}JointTrajectory", TRAJECTORY]
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
        time.sleep(8.0)
    snapshot(picture, rrd)


def drive(drivers: ExitStack, commands: Iterable[tuple[float, float, float]]) -> None:
    """Publish one Twist after the other: m/s, rad/s and its duration, s."""
    publish = ("topic", "pub", "-r", "50", TOPIC, "geometry_msgs/msg/Twist")
    for linear, angular, seconds in commands:
        before = drivers.pop_all()
        twist = f"{{linear: {{x: {linear}}}, angular: {{z: {angular}}}}}"
        drivers.enter_context(running(ONEBOT, *publish, twist, ready="#1"))
        before.close()  # only now, so that the robot does not stop between two
        time.sleep(seconds)


@contextmanager
def running(module: str, *words: str, ready: str) -> Iterator[NodeProcess]:
    """Run a command, from the time its output matches ``ready``; Ctrl-C ends it."""
    with NodeProcess(module, *words) as process:
        wait_for(lambda: re.search(ready, process.output), f"{ready} from {module}")
        yield process


def snapshot(picture: Path, rrd: Path) -> None:
    """Draw a recording."""
    command = [sys.executable, "-m", ONEBOT, "snapshot", str(picture), str(rrd), "--dashboard"]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)


_MAKERS: dict[str, Callable[[Path, Path], None]] = {
    "maze": make_maze,
    "onebot": make_onebot,
    "mrm": make_mrm,
    "arm": make_arm,
}


if __name__ == "__main__":
    sys.exit(main())
