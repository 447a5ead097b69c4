"""Where a robot is by its scans, when its wheels lie."""

import math

import numpy as np
import pytest

from onebot_control.navigation.grid import GridMap
from onebot_control.navigation.localization import Localizer
from onebot_control.navigation.scan_matching import Walls
from onebot_description.geometry.poses import PlanarPose
from tests.onebot_control.test_navigation_map import entered, room_scan

LOOSE = np.diag([0.1, 0.1, 0.1]) ** 2


def apart(one: PlanarPose, other: PlanarPose) -> tuple[float, float]:
    turn = abs(math.remainder(one.yaw - other.yaw, math.tau))
    return math.hypot(one.x - other.x, one.y - other.y), turn


@pytest.fixture(scope="module")
def walls() -> Walls:
    return Walls(entered(PlanarPose(0.1, 0.2, 0.3), PlanarPose(-0.5, 0.4, 2.0)).walls())


@pytest.mark.parametrize("seed", range(8))
def test_a_scan_is_matched(walls, seed):
    """From up to 15 cm and 0.15 rad away, to a tenth of a cell."""
    generator = np.random.default_rng(seed)
    pose = PlanarPose(*generator.uniform([-1.0, -1.0, -3.0], [1.0, 1.0, 3.0]))
    guess = PlanarPose(*(np.array(pose) + generator.uniform(-0.15, 0.15, 3)))
    match = walls.match(room_scan(pose).points, guess, LOOSE)
    assert match.share > 0.95
    away, turn = apart(match.pose, pose)
    assert away < 0.005 and turn < 0.005
    assert np.sqrt(match.covariance[0, 0]) < 0.02


def test_along_a_corridor_a_match_says_nothing():
    """There the odometry's error stays, and across it is corrected."""
    along = np.arange(-6.0, 6.0, 0.05)
    rows = [np.stack((along, np.full(len(along), y)), axis=1) for y in (-0.5, 0.5)]
    walls = Walls(np.concatenate(rows))
    points = np.concatenate(rows)[::3] - (0.0, 0.03)
    points = points[np.abs(points[:, 0]) < 3.0]
    match = walls.match(points, PlanarPose(0.0, 0.0, 0.02), LOOSE)
    assert match.pose.y == pytest.approx(0.03, abs=0.003)
    assert match.pose.yaw == pytest.approx(0.0, abs=0.003)
    spread = np.sqrt(np.diag(match.covariance))
    assert spread[0] > 10.0 * spread[1]


@pytest.mark.parametrize("gyro", [False, True])
def test_wheels_lie_of_turns(walls, gyro):
    """The robot turns by 3.9 rad where its wheels say 3.0, and learns it unless a gyro knows."""
    localizer, pose, odometry = Localizer(PlanarPose()), PlanarPose(), PlanarPose()
    worst = 0.0
    for step in range(200):
        turn = 0.1 * math.sin(step / 15.0)
        pose = pose.compose(PlanarPose(0.01, 0.0, turn))
        odometry = odometry.compose(PlanarPose(0.01, 0.0, turn / 1.3))
        localizer.predict(0.1 * step, odometry, turn if gyro else None)
        localizer.correct(0.1 * step, room_scan(pose).points, walls)
        worst = max(worst, *apart(localizer.pose, pose))
    assert worst < 0.02
    assert localizer.turn_ratio == pytest.approx(1.0 if gyro else 1.3, abs=0.1)


def test_a_scan_that_comes_late_corrects_the_past(walls):
    localizer = Localizer(PlanarPose(0.05, 0.03, 0.0), LOOSE)
    for step in range(6):
        localizer.predict(0.1 * step, PlanarPose(0.1 * step))
    assert localizer.at(0.25).x == pytest.approx(0.05 + 0.25)
    localizer.correct(0.2, room_scan(PlanarPose(0.2)).points, walls)
    assert apart(localizer.pose, PlanarPose(0.5))[0] < 0.01


def test_nothing_is_believed_of_a_scan_of_elsewhere(walls):
    localizer = Localizer(PlanarPose())
    localizer.predict(0.0, PlanarPose())
    before = localizer.pose
    localizer.correct(0.0, room_scan(half=5.0).points, walls)
    assert localizer.pose == before


def test_the_covariance_grows_on_the_way():
    localizer = Localizer(PlanarPose())
    sizes = []
    for step in range(3):
        localizer.predict(0.1 * step, PlanarPose(0.5 * step, 0.0, 0.2 * step))
        sizes.append(np.linalg.det(localizer.covariance))
    assert sizes[0] < sizes[1] < sizes[2]
    localizer.rebase()
    localizer.predict(1.0, PlanarPose(100.0))
    assert localizer.pose.x < 2.0


def test_walls_do_not_drift():
    """A cell's mean stays once it is well known, whatever is entered later."""
    grid = GridMap()
    for number in range(80):
        pose = PlanarPose(0.0, 0.0, 0.01 * number)
        scan = room_scan(pose)
        grid.enter(scan, scan.points, PlanarPose(0.004 * (number > 40), 0.0, pose.yaw))
    ahead = grid.walls()
    ahead = ahead[(np.abs(ahead[:, 1]) < 1.0) & (ahead[:, 0] > 1.0)]
    assert np.abs(ahead[:, 0] - 2.02).mean() < 0.002
