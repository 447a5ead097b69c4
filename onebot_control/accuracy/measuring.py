"""Driving the paths, and comparing where the robot should be, believes to be, and is."""

import math
import time
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from onebot_control.accuracy.paths import Path, Segment
from onebot_control.control_config import ControlConfig
from onebot_control.drive import Drive
from onebot_control.frames import PlanarPose, yaw_of
from onebot_control.odometry import Odometry
from onebot_description.description import Description


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

    path: Path
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
    paths: tuple[Path, ...],
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
    drive = Drive.of(description, config)
    try:
        began, ticks = time.process_time(), drive.ticks
        results = []
        for path in paths:
            drive.reset()
            results.append(follow(drive, path))
        spent = time.process_time() - began
        simulated = (drive.ticks - ticks) * drive.period
        drive.reset()
        standing = follow(drive, Path("rest", (Segment(0.0, 0.0, rest),)))
        factor = simulated / max(spent, 1e-9)
        return Report(tuple(results), standing.truth_worst, rest, factor, config.update_rate)
    finally:
        drive.plant.close()


def follow(drive: Drive, path: Path) -> Result:
    """Drive one path with a robot that stands at its odometry's zero."""
    commanded = Odometry(drive.controller.odometry.kinematics)
    start = drive.true_pose
    heading = start.yaw
    length = turned = odometry_worst = truth_worst = 0.0
    truth = odometry = planned = PlanarPose()
    for command in (*_commands(path, drive.period), None):
        # Without a command this is a look at the end, at rest.
        if command is not None:
            drive.accept(*command)
        snapshot = drive.begin()
        position, rotation = snapshot.pose.translation.tolist(), snapshot.pose.rotation.tolist()
        # Headings are followed round and round.
        heading += math.remainder(yaw_of(*rotation) - heading, 2.0 * math.pi)
        truth = start.inverse().then(PlanarPose(position[0], position[1], heading))
        odometry = snapshot.odometry
        odometry_worst = max(odometry_worst, deviation(odometry, truth).place)
        truth_worst = max(truth_worst, deviation(truth, planned).place)
        if command is None:
            break
        drive.finish()
        linear, angular = snapshot.command.linear, snapshot.command.angular
        commanded.update_open_loop(linear, angular, drive.period)
        planned = PlanarPose(commanded.x, commanded.y, commanded.heading)
        length += abs(linear) * drive.period
        turned += abs(angular) * drive.period
    return Result(path, planned, odometry, truth, length, turned, odometry_worst, truth_worst)


def _commands(path: Path, period: float) -> Iterator[tuple[float, float]]:
    for segment in path.segments:
        for _ in range(segment.cycles(period)):
            yield segment.command(period)
