"""``onebot accuracy``: measure, print the table, and write it where it is asked for."""

import argparse
import math
import sys
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from onebot_control.driven_robot import DrivenRobot
from onebot_control.odometry import Odometry
from onebot_control.parameters import ControlConfig, default_control_file, read_control_files
from onebot_control.poses import PlanarPose, yaw_of
from onebot_description.description import Description, load_description
from onebot_description.errors import OneBotError

# The paths that are driven: what is commanded, for how long.

LINEAR = 0.2  # m/s
ANGULAR = 0.5  # rad/s
_CROSSING = 0.5  # s
_REST = 1.0  # s, long enough for OneBot's limiter to stop


class Segment(NamedTuple):
    """A command held for a while.

    Attributes:
        linear: m/s, forward.
        angular: rad/s, to the left.
        duration: s.
    """

    linear: float
    angular: float
    duration: float

    def cycles(self, period: float) -> int:
        """Control cycles of ``period`` seconds it takes, the last one whole."""
        return math.ceil(self.duration / period - 1e-9)

    def command(self, period: float) -> tuple[float, float]:
        """Linear and angular velocity that cover the same way in whole cycles.

        They are slower by less than a cycle's share. A limiter that brakes as it accelerates does
        not change the way covered: what is missing at one end comes at the other.
        """
        share = self.duration / (self.cycles(period) * period)
        return self.linear * share, self.angular * share


class DrivenPath(NamedTuple):
    """Segments driven one after the other, from rest.

    Attributes:
        name: for the table.
        segments: what is commanded.
        turning: a turn on the spot, whose error is one of heading, not of place.
    """

    name: str
    segments: tuple[Segment, ...]
    turning: bool = False


def straight(way: float, speed: float = LINEAR) -> tuple[Segment, ...]:
    """``way`` metres ahead, then rest."""
    return Segment(speed, 0.0, way / speed), Segment(0.0, 0.0, _REST)


def turn(angle: float, speed: float = ANGULAR) -> tuple[Segment, ...]:
    """``angle`` radians to the left on the spot, then rest."""
    return Segment(0.0, speed, angle / speed), Segment(0.0, 0.0, _REST)


def eight(radius: float, speed: float = LINEAR) -> tuple[Segment, ...]:
    """A circle to the left, a little straight on, and a circle to the right without a stop."""
    rate = speed / radius
    once_round = 2.0 * math.pi / rate
    return (
        Segment(speed, rate, once_round),
        # Long enough for the limiter to straighten out; without it the circles would not close.
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


# Driving the paths, and comparing where the robot should be, believes to be, and is.


class Deviation(NamedTuple):
    """How far one pose is from another.

    Attributes:
        place: m.
        heading: rad.
    """

    place: float
    heading: float


class Result(NamedTuple):
    """What a path came to. All poses are relative to the start, headings are not wrapped.

    Attributes:
        path: that was driven.
        commanded: end of the path that the limited command describes, followed along exact arcs.
        odometry: end by wheel odometry.
        truth: where the robot is.
        length: m, of the way commanded.
        turned: rad, all turning commanded, left and right added up.
        odometry_worst: m, the farthest odometry was from truth on the way.
        truth_worst: m, the same of truth from command.
    """

    path: DrivenPath
    commanded: PlanarPose
    odometry: PlanarPose
    truth: PlanarPose
    length: float
    turned: float
    odometry_worst: float
    truth_worst: float

    @property
    def odometry_error(self) -> float:
        """Of odometry against truth, as a share; see ``share``."""
        return self.share(deviation(self.odometry, self.truth))

    @property
    def truth_error(self) -> float:
        """Of truth against the command, as a share; see ``share``."""
        return self.share(deviation(self.truth, self.commanded))

    def share(self, apart: Deviation) -> float:
        """An error at the end of the path, relative to the path.

        The distance between the ends divided by the length of the way (the closing error of a
        survey), or the difference of headings divided by all turning, whichever is greater. A turn
        on the spot has no length, so only its heading counts.
        """
        shares = [apart.heading / self.turned if self.turned > 1e-9 else 0.0]
        if not self.path.turning:
            shares.append(apart.place / self.length)
        # Unlike max(), it lets no NaN pass for a small number.
        return float(np.max(shares))


class Report(NamedTuple):
    """The whole experiment.

    Attributes:
        results: of the paths.
        rest_drift: m, the farthest that a robot at rest was from its start within ``rest`` seconds.
        rest: s.
        real_time_factor: simulated seconds for each second of processor time while driving.
        rate: control cycles a second.
    """

    results: tuple[Result, ...]
    rest_drift: float
    rest: float
    real_time_factor: float
    rate: float


def deviation(one: PlanarPose, other: PlanarPose) -> Deviation:
    """How far apart two poses are."""
    return Deviation(math.hypot(one.x - other.x, one.y - other.y), abs(one.yaw - other.yaw))


def measure(
    description: Description,
    config: ControlConfig,
    paths: tuple[DrivenPath, ...],
    rest: float = 60.0,
) -> Report:
    """Drive ``paths``, each from the robot's start, and let it rest.

    Args:
        description: of the robot.
        config: of its controller.
        paths: to drive.
        rest: s to stand still for.

    Raises:
        OneBotError: robot and config do not suit each other, or cannot be simulated.
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
        standing = follow(robot, DrivenPath("rest", (Segment(0.0, 0.0, rest),)))
        factor = simulated / max(spent, 1e-9)
        return Report(tuple(results), standing.truth_worst, rest, factor, config.update_rate)
    finally:
        robot.plant.close()


def follow(robot: DrivenRobot, path: DrivenPath) -> Result:
    """Drive one path with a robot that stands at its odometry's zero."""
    commanded = Odometry(robot.controller.odometry.kinematics)
    start = robot.true_pose
    heading = start.yaw
    length = turned = odometry_worst = truth_worst = 0.0
    truth = odometry = planned = PlanarPose()
    for command in (*_commands(path, robot.period), None):
        # Without a command this is a look at the end, at rest.
        if command is not None:
            robot.accept(*command)
        snapshot = robot.begin()
        position, rotation = snapshot.pose.translation.tolist(), snapshot.pose.rotation.tolist()
        # Headings are followed round and round.
        heading += math.remainder(yaw_of(*rotation) - heading, 2.0 * math.pi)
        truth = start.inverse().then(PlanarPose(position[0], position[1], heading))
        odometry = snapshot.odometry
        odometry_worst = max(odometry_worst, deviation(odometry, truth).place)
        truth_worst = max(truth_worst, deviation(truth, planned).place)
        if command is None:
            break
        robot.finish()
        linear, angular = snapshot.command.linear, snapshot.command.angular
        commanded.update_open_loop(linear, angular, robot.period)
        planned = PlanarPose(commanded.x, commanded.y, commanded.heading)
        length += abs(linear) * robot.period
        turned += abs(angular) * robot.period
    return Result(path, planned, odometry, truth, length, turned, odometry_worst, truth_worst)


def _commands(path: DrivenPath, period: float) -> Iterator[tuple[float, float]]:
    for segment in path.segments:
        for _ in range(segment.cycles(period)):
            yield segment.command(period)


# The experiment as a table in Markdown, and putting it where it belongs.

BEGIN, END = "<!-- accuracy -->", "<!-- /accuracy -->"

# What the project promises: shares, metres, simulated seconds a second.
ODOMETRY_GOAL = 0.0005
TRUTH_GOAL = 0.005
REST_GOAL = 1e-5
FACTOR_GOAL = 15.0

_HEAD = (
    "Path",
    "Commanded: x, y, heading",
    "Odometry",
    "Truth",
    "Odometry to truth",
    "Truth to command",
)


def table(report: Report) -> str:
    """Return the report as Markdown."""
    rows = [_HEAD, ("---",) * len(_HEAD), *(_row(result) for result in report.results)]
    lines = [f"| {' | '.join(row)} |" for row in rows]
    lines += [
        "",
        f"At rest the robot moves {1e3 * report.rest_drift:.6f} mm in {report.rest:g} s. "
        f"Physics and control at {report.rate:g} Hz run {report.real_time_factor:.0f} times faster "
        "than real time on one core.",
    ]
    return "\n".join(lines) + "\n"


def missed(report: Report) -> list[str]:
    """Return a sentence for each goal that is missed."""
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
    if not report.real_time_factor >= FACTOR_GOAL:
        sentences.append(f"real-time factor {report.real_time_factor:.1f}; goal {FACTOR_GOAL:g}")
    return sentences


def write(file: Path, text: str) -> None:
    """Put ``text`` between the marks in ``file``; a file that is not there is made.

    Raises:
        OneBotError: the file has no marks, or cannot be read or written.
    """
    try:
        old = file.read_text(encoding="utf-8") if file.exists() else f"{BEGIN}\n{END}\n"
        before, begin, rest = old.partition(BEGIN)
        _, end, after = rest.partition(END)
        if not (begin and end):
            raise OneBotError(f"{file}: has no lines {BEGIN} and {END} to put the table between")
        file.write_text(f"{before}{BEGIN}\n{text}{END}{after}", encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise OneBotError(f"{file}: {error}") from None


def _row(result: Result) -> tuple[str, ...]:
    poses = (result.commanded, result.odometry, result.truth)
    errors = (
        (result.odometry_error, result.odometry_worst),
        (result.truth_error, result.truth_worst),
    )
    return (
        result.path.name,
        *(_pose(pose) for pose in poses),
        *(f"{error:.4%}, at most {1e3 * worst:.3f} mm" for error, worst in errors),
    )


def _pose(pose: PlanarPose) -> str:
    # Adding 0 turns -0.0 into 0.0.
    x, y = (round(1e3 * value, 3) + 0.0 for value in (pose.x, pose.y))
    return f"{x:.3f} mm, {y:.3f} mm, {round(math.degrees(pose.yaw), 4) + 0.0:.4f}°"


def main(argv: Sequence[str]) -> int:
    """Run the command.

    Returns:
        0 if every goal is met, else 1; the goals missed are on stderr.

    Raises:
        OneBotError: a file is missing or wrong.
    """
    parser = argparse.ArgumentParser(prog="onebot accuracy", description=__doc__)
    parser.add_argument(
        "--robot",
        default="package://onebot_description/urdf/onebot.urdf.xacro",
        help="URDF or xacro file (default: OneBot)",
    )
    parser.add_argument("--control", type=Path, help="control.yaml (default: OneBot's)")
    parser.add_argument(
        "--write",
        type=Path,
        metavar="FILE",
        help=f"also put the table into FILE, between the lines {BEGIN} and {END}",
    )
    arguments = parser.parse_args(argv)
    file = arguments.control or default_control_file()
    parameters = read_control_files([file], "/", "velocity_controller")
    config = ControlConfig.from_parameters(parameters.values)
    report = measure(load_description(arguments.robot), config, PATHS)
    text = table(report)
    print(text, end="")
    if arguments.write is not None:
        write(arguments.write, text)
    failures = missed(report)
    for sentence in failures:
        print(sentence, file=sys.stderr)
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
