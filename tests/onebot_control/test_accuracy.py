"""The accuracy that the README promises."""

import math
from pathlib import Path

import numpy as np
import pytest

from onebot_description.description import load_description
from tests.accuracy import (
    ODOMETRY_GOAL,
    ONEBOT,
    PATHS,
    TRUTH_GOAL,
    DrivenPath,
    Result,
    measure,
    missed,
    rest_drift,
    straight,
    table,
    turn,
)

ROBOTS = Path(__file__).resolve().parents[1] / "robots"
DIFF_DRIVE = str(ROBOTS / "diff_drive.urdf")


def test_goals_are_met() -> None:
    """Odometry within 0.05 % of truth, truth within 0.5 % of command, rest below 0.01 mm."""
    description = load_description(ONEBOT)
    results = measure(description, PATHS)
    drift = 12.0 * rest_drift(description, 5.0)  # in a minute
    assert missed(results, drift) == []
    for result in results:  # at the end odometry is inside its ellipse of 99 %
        off = np.array(result.odometry) - np.array(result.truth)
        assert off @ np.linalg.solve(result.covariance, off) < 11.34
    _check_commands(*results)


def _check_commands(two_meters: Result, full_turn: Result, square: Result, figure: Result) -> None:
    """By the integral of the limited command: 2 m, 360 degrees, a closed square, two circles."""
    assert two_meters.length == pytest.approx(2.0)
    assert two_meters.commanded == pytest.approx((2.0, 0.0, 0.0))
    assert full_turn.turned == pytest.approx(2.0 * math.pi)
    assert full_turn.commanded == pytest.approx((0.0, 0.0, 2.0 * math.pi))
    assert square.length == pytest.approx(4.0)
    assert square.commanded == pytest.approx((0.0, 0.0, 2.0 * math.pi), abs=1e-9)
    assert figure.turned == pytest.approx(4.0 * math.pi)
    assert figure.commanded.yaw == pytest.approx(0.0, abs=1e-9)
    lines = table([two_meters], 1e-9).splitlines()
    assert lines[2].startswith("| 2 m straight at 0.2 m/s | 0.0000%, at most 0.000 mm |")
    assert lines[-1] == "At rest the robot moves 0.000001 mm in 60 s."


@pytest.mark.parametrize("rate", [33.3, 1000])
def test_odometry_is_as_accurate_at_every_control_rate(rate: float) -> None:
    paths = DrivenPath("line", straight(0.4)), DrivenPath("spot", turn(0.5), turning=True)
    for result in measure(load_description(DIFF_DRIVE), paths, {"update_rate": rate}):
        assert result.odometry_error < ODOMETRY_GOAL
        assert result.truth_error < TRUTH_GOAL


def test_wrong_odometry_is_seen() -> None:
    """A wheel that is believed 1 % larger than it is shows as 1 %."""
    wrong = {f"{side}_wheel_radius_multiplier": 1.01 for side in ("left", "right")}
    results = measure(load_description(DIFF_DRIVE), [DrivenPath("line", straight(0.4))], wrong)
    assert results[0].odometry_error == pytest.approx(0.01, rel=0.01)
    assert "odometry is off truth" in missed(results, 0.0)[0]
