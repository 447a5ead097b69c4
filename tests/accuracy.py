"""Odometry and motion accuracy of simulated robots, for onebot_control/docs/accuracy.md.

``python -m tests.accuracy`` drives OneBot along the paths and writes the first table; with files of
robots it drives each 2 m and once round, and writes the second one.
"""

import math
import re
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from onebot_control import Simulation
from onebot_control.drive.diff_drive import DiffDriveKinematics
from onebot_control.drive.odometry import Odometry
from onebot_description.description import Description, load_description
from onebot_description.errors import OneBotError
from onebot_description.geometry.poses import PlanarPose, PlanarVelocity
from tests.readme import CHECKOUT

ONEBOT = "package://onebot_description/urdf/onebot.urdf.xacro"
_LINEAR, _ANGULAR = 0.2, 0.5  # m/s, rad/s
_REST = 1.0  # s, long enough for OneBot's limiter to stop

# The goals of the project: shares, m.
ODOMETRY_GOAL, TRUTH_GOAL, REST_GOAL = 0.0005, 0.005, 1e-5

_HEAD = "Path | Odometry to truth | Truth to command"
_ROBOTS_HEAD = "Robot | 2 m straight: truth | 360° turn: odometry; truth"


class Segment(NamedTuple):
    """A constant command."""

    linear: float  # m/s, forward
    angular: float  # rad/s, to the left
    duration: float  # s

    def commands(self, period: float) -> Iterator[tuple[float, float]]:
        """Yield a velocity for each control cycle; whole cycles cover the same distance.

        A limiter with equal acceleration and deceleration does not change the distance: what is
        missing at the start is added at the end.
        """
        cycles = math.ceil(self.duration / period - 1e-9)
        share = self.duration / (cycles * period)
        for _ in range(cycles):
            yield self.linear * share, self.angular * share


class DrivenPath(NamedTuple):
    """Segments driven one after the other, from rest."""

    name: str
    segments: tuple[Segment, ...]
    turning: bool = False  # a turn on the spot, whose error is in heading, not in position


def straight(distance: float) -> tuple[Segment, ...]:
    """Drive ``distance`` meters ahead, then rest."""
    return Segment(_LINEAR, 0.0, distance / _LINEAR), Segment(0.0, 0.0, _REST)


def turn(angle: float) -> tuple[Segment, ...]:
    """Turn ``angle`` radians to the left on the spot, then rest."""
    return Segment(0.0, _ANGULAR, angle / _ANGULAR), Segment(0.0, 0.0, _REST)


def eight(radius: float) -> tuple[Segment, ...]:
    """Drive a circle to the left, a short straight and a circle to the right, without a stop."""
    rate = _LINEAR / radius
    once_round = 2.0 * math.pi / rate
    return (
        Segment(_LINEAR, rate, once_round),
        # Long enough for the limiter to reach zero turn rate; else the circles would not close.
        Segment(_LINEAR, 0.0, 0.5),
        Segment(_LINEAR, -rate, once_round),
        Segment(0.0, 0.0, _REST),
    )


PATHS = (
    DrivenPath("2 m straight at 0.2 m/s", straight(2.0)),
    DrivenPath("360° turn at 0.5 rad/s", turn(2.0 * math.pi), turning=True),
    DrivenPath("square of 1 m", (*straight(1.0), *turn(math.pi / 2.0)) * 4),
    DrivenPath("figure of eight, 2 circles of 1 m", eight(0.5)),
)


class Result(NamedTuple):
    """The result of a path. All poses are relative to the start, headings are not wrapped."""

    path: DrivenPath
    commanded: PlanarPose  # final pose of the limited command, integrated along exact arcs
    odometry: PlanarPose  # final pose by wheel odometry
    covariance: NDArray[np.float64]  # (3, 3), of x, y and yaw of the odometry
    truth: PlanarPose  # final pose of the simulated robot
    length: float  # m, of the commanded path
    turned: float  # rad, all commanded turning, left and right added up
    odometry_worst: float  # m, the largest distance of odometry from truth on the path
    truth_worst: float  # m, the largest distance of truth from the command

    @property
    def odometry_error(self) -> float:
        """The error of odometry relative to truth, as a share of the path."""
        return self._share(self.odometry, self.truth)

    @property
    def truth_error(self) -> float:
        """The error of truth relative to the command, as a share of the path."""
        return self._share(self.truth, self.commanded)

    def _share(self, pose: PlanarPose, true_pose: PlanarPose) -> float:
        """The greater of the distance by the length and the difference of headings by all turning.

        A turn on the spot has no length, so only its heading counts.
        """
        heading = abs(pose.yaw - true_pose.yaw)
        shares = [heading / self.turned if self.turned > 1e-9 else 0.0]
        if not self.path.turning:
            shares.append(math.dist(pose[:2], true_pose[:2]) / self.length)
        # Unlike max(), this returns NaN if any is NaN.
        return float(np.max(shares))


def measure(
    description: Description,
    paths: Iterable[DrivenPath],
    parameters: Mapping[str, Any] = MappingProxyType({}),
) -> list[Result]:
    """Drive ``paths``, each from the robot's start."""
    with Simulation(description, parameters=parameters) as simulation:
        return [_follow(simulation, path) for path in paths]


def _follow(simulation: Simulation, path: DrivenPath) -> Result:
    simulation.reset()
    robot, period = simulation.robot, simulation.period
    commanded = Odometry(DiffDriveKinematics(1.0, 1.0, 1.0))  # by velocities, not by wheels
    start = PlanarPose(robot.pose.x, robot.pose.y, robot.pose.yaw)
    heading, odometry_yaw = start.yaw, 0.0
    length = turned = odometry_worst = truth_worst = 0.0
    for command in (command for part in path.segments for command in part.commands(period)):
        robot.drive(*command)
        simulation.run(period)
        linear, angular = robot.command.linear, robot.command.angular
        commanded.update_open_loop(PlanarVelocity(linear, 0.0, angular), period)
        length += abs(linear) * period
        turned += abs(angular) * period
        # Headings are unwrapped.
        heading += math.remainder(robot.pose.yaw - heading, math.tau)
        odometry_yaw += math.remainder(robot.odometry.yaw - odometry_yaw, math.tau)
        truth = start.inverse().compose(PlanarPose(robot.pose.x, robot.pose.y, heading))
        odometry = PlanarPose(robot.odometry.x, robot.odometry.y, odometry_yaw)
        odometry_worst = max(odometry_worst, math.dist(odometry[:2], truth[:2]))
        truth_worst = max(truth_worst, math.dist(truth[:2], commanded.pose[:2]))
    return Result(
        path,
        commanded.pose,
        odometry,
        np.array(robot.odometry.covariance),
        truth,
        length,
        turned,
        odometry_worst,
        truth_worst,
    )


def rest_drift(description: Description, seconds: float = 60.0) -> float:
    """Return the largest distance of a robot at rest from its start, m."""
    path = DrivenPath("rest", (Segment(0.0, 0.0, seconds),))
    return measure(description, [path])[0].truth_worst


def table(results: Iterable[Result], drift: float) -> str:
    """Return the results as Markdown."""
    rest = f"At rest the robot moves {1e3 * drift:.6f} mm in 60 s."
    return f"{_markdown(_HEAD, map(_row, results))}\n{rest}\n"


def robots_table(files: Iterable[str], paths: Sequence[DrivenPath] = PATHS[:2]) -> str:
    """Drive 2 m and turn once with each robot, and return the results as Markdown.

    Robots of the same result share a row.
    """
    names: dict[tuple[str, ...], list[str]] = {}
    for file in files:
        name, *cells = _robot(file, paths)
        names.setdefault(tuple(cells), []).append(name)
    return _markdown(_ROBOTS_HEAD, [(", ".join(names[cells]), *cells) for cells in names])


def missed(results: Iterable[Result], drift: float) -> list[str]:
    """Return a sentence for each missed goal."""
    sentences = []
    for result in results:
        for what, error, goal in (
            ("odometry is off truth", result.odometry_error, ODOMETRY_GOAL),
            ("truth is off the command", result.truth_error, TRUTH_GOAL),
        ):
            if not error <= goal:
                sentences.append(f"{result.path.name}: {what} by {error:.3%}; goal {goal:.2%}")
    if not drift < REST_GOAL:
        sentences.append(f"at rest the robot moves {1e3 * drift:.4f} mm; goal {1e3 * REST_GOAL} mm")
    return sentences


def _markdown(head: str, rows: Iterable[Sequence[str]]) -> str:
    columns = head.count("|") + 1
    lines = [head, " | ".join(["---"] * columns), *(" | ".join(row) for row in rows)]
    return "".join(f"| {line} |\n" for line in lines)


def _row(result: Result) -> Sequence[str]:
    errors = (
        (result.odometry_error, result.odometry_worst),
        (result.truth_error, result.truth_worst),
    )
    cells = [f"{error:.4%}, at most {1e3 * worst:.3f} mm" for error, worst in errors]
    return [result.path.name, *cells]


def _robot(file: str, paths: Sequence[DrivenPath]) -> tuple[str, ...]:
    description = load_description(file)
    try:
        ahead, turned = measure(description, paths)
    except OneBotError as error:
        reason = str(error).splitlines()[0].split(". ")[0].split("cannot be driven: ")[-1]
        return description.robot_name, f"refused: {reason}", ""
    x, y, yaw = ahead.truth
    return (
        description.robot_name,
        # Adding 0 turns -0.0 into 0.0.
        f"{x:.4f} m, {round(1e3 * y, 1) + 0.0:.1f} mm aside, "
        f"{round(math.degrees(yaw), 2) + 0.0:.2f}°",
        f"{math.degrees(turned.odometry.yaw):.2f}°; {math.degrees(turned.truth.yaw):.2f}°",
    )


def main(files: Sequence[str]) -> int:
    """Write a table to its document; return 1 if a goal is missed, and print which."""
    failures: list[str] = []
    if files:
        name, text = "accuracy of robots", robots_table(files)
    else:
        onebot = load_description(ONEBOT)
        results, drift = measure(onebot, PATHS), rest_drift(onebot)
        name, text, failures = "accuracy", table(results, drift), missed(results, drift)
    readme = CHECKOUT / "onebot_control/docs/accuracy.md"
    marked = rf"(<!-- {name} -->\n).*?(<!-- /{name} -->)"
    readme.write_text(
        re.sub(marked, lambda mark: f"{mark[1]}{text}{mark[2]}", readme.read_text(), flags=re.S)
    )
    print(text, *failures, sep="\n", end="")
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
