"""Odometry and motion accuracy of a simulated robot: ``python -m onebot_control.accuracy``.

`measure` drives the paths and compares command, odometry and true pose; `table` prints the result.
"""

import argparse
import math
import sys
import time
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from onebot_control.driven_robot import DrivenRobot, wheels_of
from onebot_control.odometry import Odometry, PoseCovariance
from onebot_control.parameters import ControlConfig, default_control_file, read_control_files
from onebot_control.poses import PlanarPose, yaw_of
from onebot_description.description import Description, load_description
from onebot_description.errors import OneBotError

_SUMMARY = "Measure the accuracy of odometry and motion in simulation, and print it as a table."
LINEAR = 0.2  # m/s
ANGULAR = 0.5  # rad/s
_CROSSING = 0.5  # s
_REST = 1.0  # s, long enough for OneBot's limiter to stop

# The goals of the project: shares, m.
ODOMETRY_GOAL = 0.0005
TRUTH_GOAL = 0.005
REST_GOAL = 1e-5

ACCURACY, ROBOTS = "accuracy", "accuracy of robots"  # names of tables in Markdown files
_HEAD = "Path | Commanded: x, y, heading | Odometry | Truth | Odometry to truth | Truth to command"
_ROBOTS_HEAD = (
    "Robot | File | Wheels; separation, radius | 2 m straight: odometry; truth | "
    "360° turn: odometry; truth"
)


class Segment(NamedTuple):
    """A constant command."""

    linear: float  # m/s, forward
    angular: float  # rad/s, to the left
    duration: float  # s

    def cycles(self, period: float) -> int:
        """The number of control cycles of ``period`` seconds, rounded up."""
        return math.ceil(self.duration / period - 1e-9)

    def command(self, period: float) -> tuple[float, float]:
        """Linear and angular velocity that cover the same distance in whole cycles.

        A limiter with equal acceleration and deceleration does not change the distance: what is
        missing at the start is added at the end.
        """
        share = self.duration / (self.cycles(period) * period)
        return self.linear * share, self.angular * share


class DrivenPath(NamedTuple):
    """Segments driven one after the other, from rest."""

    name: str  # heading in the table
    segments: tuple[Segment, ...]
    turning: bool = False  # a turn on the spot, whose error is in heading, not in position


def straight(distance: float, speed: float = LINEAR) -> tuple[Segment, ...]:
    """Drive ``distance`` metres ahead, then rest."""
    return Segment(speed, 0.0, distance / speed), Segment(0.0, 0.0, _REST)


def turn(angle: float, speed: float = ANGULAR) -> tuple[Segment, ...]:
    """Turn ``angle`` radians to the left on the spot, then rest."""
    return Segment(0.0, speed, angle / speed), Segment(0.0, 0.0, _REST)


def eight(radius: float, speed: float = LINEAR) -> tuple[Segment, ...]:
    """Drive a circle to the left, a short straight and a circle to the right, without a stop."""
    rate = speed / radius
    once_round = 2.0 * math.pi / rate
    return (
        Segment(speed, rate, once_round),
        # Long enough for the limiter to reach zero turn rate; else the circles would not close.
        Segment(speed, 0.0, _CROSSING),
        Segment(speed, -rate, once_round),
        Segment(0.0, 0.0, _REST),
    )


PATHS = (
    DrivenPath("2 m straight at 0.2 m/s", straight(2.0)),
    DrivenPath("360° turn at 0.5 rad/s", turn(2.0 * math.pi), turning=True),
    DrivenPath("square of 1 m", (*straight(1.0), *turn(math.pi / 2.0)) * 4),
    DrivenPath("figure of eight, 2 circles of 1 m", eight(0.5)),
)


class Deviation(NamedTuple):
    """The distance between two poses."""

    position: float  # m
    heading: float  # rad


class Result(NamedTuple):
    """The result of a path. All poses are relative to the start, headings are not wrapped."""

    path: DrivenPath
    commanded: PlanarPose  # final pose of the limited command, integrated along exact arcs
    odometry: PlanarPose  # final pose by wheel odometry
    covariance: PoseCovariance  # the odometry's
    truth: PlanarPose  # final pose of the simulated robot
    length: float  # m, of the commanded path
    turned: float  # rad, all commanded turning, left and right added up
    odometry_worst: float  # m, the largest distance of odometry from truth on the path
    truth_worst: float  # m, the largest distance of truth from the command

    @property
    def odometry_error(self) -> float:
        """The error of odometry relative to truth; see ``share``."""
        return self.share(deviation(self.odometry, self.truth))

    @property
    def truth_error(self) -> float:
        """The error of truth relative to the command; see ``share``."""
        return self.share(deviation(self.truth, self.commanded))

    def share(self, error: Deviation) -> float:
        """The final error relative to the path.

        The greater of the distance divided by the length of the path (the closing error of a
        survey) and the difference of headings divided by all turning. A turn on the spot has no
        length, so only its heading counts.
        """
        shares = [error.heading / self.turned if self.turned > 1e-9 else 0.0]
        if not self.path.turning:
            shares.append(error.position / self.length)
        # Unlike max(), this returns NaN if any is NaN.
        return float(np.max(shares))


class Report(NamedTuple):
    """The results of all paths, of a robot at rest, and of the simulation's speed."""

    results: tuple[Result, ...]
    rest_drift: float  # m, the largest distance of a robot at rest from its start
    rest: float  # s, the duration of that rest
    real_time_factor: float  # simulated seconds per second of processor time while driving
    rate: float  # control cycles per second


def deviation(one: PlanarPose, other: PlanarPose) -> Deviation:
    """Return the distance between two poses."""
    return Deviation(math.hypot(one.x - other.x, one.y - other.y), abs(one.yaw - other.yaw))


def measure(
    description: Description,
    config: ControlConfig,
    paths: tuple[DrivenPath, ...],
    rest: float = 60.0,
) -> Report:
    """Drive ``paths``, each from the robot's start, then measure its drift in ``rest`` seconds.

    Raises:
        OneBotError: robot and config do not match, or cannot be simulated.
    """
    robot = DrivenRobot.of(description, config)
    try:
        began, ticks = time.process_time(), robot.ticks
        results = []
        for path in paths:
            robot.reset()
            results.append(follow(robot, path))
        spent = time.process_time() - began
        simulated = (robot.ticks - ticks) * robot.period
        robot.reset()
        at_rest = follow(robot, DrivenPath("rest", (Segment(0.0, 0.0, rest),)))
        factor = simulated / max(spent, 1e-9)
        return Report(tuple(results), at_rest.truth_worst, rest, factor, config.update_rate)
    finally:
        robot.plant.close()


def follow(robot: DrivenRobot, path: DrivenPath) -> Result:
    """Drive one path; the odometry of the robot must be at zero."""
    commanded = Odometry(robot.controller.odometry.kinematics)
    start = robot.true_pose
    heading = start.yaw
    length = turned = odometry_worst = truth_worst = 0.0
    truth = odometry = planned = PlanarPose()
    for command in (*_commands(path, robot.period), None):
        if command is None:  # compare the final poses, at rest
            snapshot = robot.begin()
        else:
            robot.accept(*command)
            snapshot = robot.cycle()
        position, rotation = snapshot.pose.translation.tolist(), snapshot.pose.rotation.tolist()
        # Headings are unwrapped.
        heading += math.remainder(yaw_of(*rotation) - heading, 2.0 * math.pi)
        truth = start.inverse().compose(PlanarPose(position[0], position[1], heading))
        odometry = snapshot.odometry
        odometry_worst = max(odometry_worst, deviation(odometry, truth).position)
        truth_worst = max(truth_worst, deviation(truth, planned).position)
        if command is None:
            break
        linear, angular = snapshot.command.linear, snapshot.command.angular
        commanded.update_open_loop(linear, angular, robot.period)
        planned = PlanarPose(commanded.x, commanded.y, commanded.heading)
        length += abs(linear) * robot.period
        turned += abs(angular) * robot.period
    covariance = snapshot.covariance
    return Result(
        path, planned, odometry, covariance, truth, length, turned, odometry_worst, truth_worst
    )


def _commands(path: DrivenPath, period: float) -> Iterator[tuple[float, float]]:
    for segment in path.segments:
        for _ in range(segment.cycles(period)):
            yield segment.command(period)


def table(report: Report) -> str:
    """Return the report as Markdown."""
    return (
        f"{_markdown(_HEAD, map(_row, report.results))}\n"
        f"At rest the robot moves {1e3 * report.rest_drift:.6f} mm in {report.rest:g} s. "
        f"Physics and control at {report.rate:g} Hz run {report.real_time_factor:.0f} times faster "
        "than real time on one core.\n"
    )


def _markdown(head: str, rows: Iterable[Sequence[str]]) -> str:
    columns = head.count("|") + 1
    lines = [head, " | ".join(["---"] * columns), *(" | ".join(row) for row in rows)]
    return "".join(f"| {line} |\n" for line in lines)


def missed(report: Report) -> list[str]:
    """Return a sentence for each missed goal."""
    sentences = []
    for result in report.results:
        for what, error, goal in (
            ("odometry is off truth", result.odometry_error, ODOMETRY_GOAL),
            ("truth is off the command", result.truth_error, TRUTH_GOAL),
        ):
            if not error <= goal:
                sentences.append(f"{result.path.name}: {what} by {error:.3%}; goal {goal:.2%}")
    if not report.rest_drift < REST_GOAL:
        sentences.append(
            f"at rest the robot moves {1e3 * report.rest_drift:.4f} mm; goal {1e3 * REST_GOAL:g} mm"
        )
    return sentences


def robots_table(files: Sequence[str], config: ControlConfig) -> str:
    """Drive 2 m and turn once with each robot, and return the results as Markdown.

    The row of a robot that cannot be driven has the reason.
    """
    return _markdown(_ROBOTS_HEAD, [_robot(file, config) for file in files])


def _robot(file: str, config: ControlConfig) -> tuple[str, ...]:
    name = "/".join(Path(file).parts[-2:])
    try:
        description = load_description(file)
    except OneBotError as error:
        return "", name, f"unreadable: {_first_sentence(error)}", "", ""
    try:
        wheels = wheels_of(description, config)
        straight_on, turned = measure(description, config, PATHS[:2], rest=0.1).results
    except OneBotError as error:
        return description.robot_name, name, f"refused: {_first_sentence(error)}", "", ""
    x, y, yaw = straight_on.truth
    return (
        description.robot_name,
        name,
        f"{len(wheels.names)}; {wheels.separation:.3f} m, {wheels.radius:.3f} m",
        f"{straight_on.odometry.x:.4f} m; {x:.4f} m, {round(1e3 * y, 1) + 0.0:.1f} mm aside, "
        f"{round(math.degrees(yaw), 2) + 0.0:.2f}°",
        f"{math.degrees(turned.odometry.yaw):.2f}°; {math.degrees(turned.truth.yaw):.2f}°",
    )


def _first_sentence(error: OneBotError) -> str:
    return str(error).splitlines()[0].split(". ")[0].split("cannot be driven: ")[-1]


def write(file: Path, text: str, name: str = ACCURACY) -> None:
    """Write ``text`` between the markers of table ``name`` in a file, which is made if missing.

    Raises:
        OneBotError: the file has no markers, or cannot be read or written.
    """
    first, last = f"<!-- {name} -->", f"<!-- /{name} -->"
    try:
        old = file.read_text(encoding="utf-8") if file.exists() else f"{first}\n{last}\n"
        head, begin, tail = old.partition(first)
        _, end, tail = tail.partition(last)
        if not (begin and end):
            raise OneBotError(f"{file}: has no lines {first} and {last} to write the table between")
        file.write_text(f"{head}{first}\n{text}{last}{tail}", encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise OneBotError(f"{file}: {error}") from None


def _row(result: Result) -> Sequence[str]:
    poses = (result.commanded, result.odometry, result.truth)
    errors = (
        (result.odometry_error, result.odometry_worst),
        (result.truth_error, result.truth_worst),
    )
    cells = [f"{error:.4%}, at most {1e3 * worst:.3f} mm" for error, worst in errors]
    return [result.path.name, *map(_pose, poses), *cells]


def _pose(pose: PlanarPose) -> str:
    # Adding 0 turns -0.0 into 0.0.
    x, y = (round(1e3 * value, 3) + 0.0 for value in (pose.x, pose.y))
    return f"{x:.3f} mm, {y:.3f} mm, {round(math.degrees(pose.yaw), 4) + 0.0:.4f}°"


def main(argv: Sequence[str]) -> int:
    """Run the command.

    Returns:
        0 if every goal of accuracy is met, else 1; missed goals are printed on stderr. The speed of
        the machine does not count.

    Raises:
        OneBotError: a file is missing or wrong.
    """
    parser = argparse.ArgumentParser(prog="python -m onebot_control.accuracy", description=_SUMMARY)
    parser.add_argument(
        "--robot",
        default="package://onebot_description/urdf/onebot.urdf.xacro",
        help="URDF or xacro file (default: OneBot)",
    )
    parser.add_argument(
        "--robots",
        nargs="+",
        metavar="FILE",
        help="drive 2 m and turn once with each of these robots instead",
    )
    parser.add_argument("--control", type=Path, help="control.yaml (default: OneBot's)")
    parser.add_argument(
        "--write",
        type=Path,
        metavar="FILE",
        help=f"also write the table to FILE, between the lines <!-- {ACCURACY} --> and "
        f"<!-- /{ACCURACY} -->, with --robots <!-- {ROBOTS} --> and <!-- /{ROBOTS} -->",
    )
    arguments = parser.parse_args(argv)
    file = arguments.control or default_control_file()
    parameters = read_control_files([file], "/", "velocity_controller")
    config = ControlConfig.from_parameters(parameters.values)
    if arguments.robots:
        name, text, failures = ROBOTS, robots_table(arguments.robots, config), []
    else:
        report = measure(load_description(arguments.robot), config, PATHS)
        name, text, failures = ACCURACY, table(report), missed(report)
    print(text, end="")
    if arguments.write is not None:
        write(arguments.write, text, name)
    for sentence in failures:
        print(sentence, file=sys.stderr)
    return 1 if failures else 0


if __name__ == "__main__":
    try:
        sys.exit(main(sys.argv[1:]))
    except OneBotError as problem:
        sys.exit(f"error: {problem}")
