"""Where the robot is in the map: its odometry, corrected by matched scans.

The odometry, with the turning of an IMU in place of the wheels' if there is one, predicts how the
robot has moved since the last scan, which is then matched to the walls of the map. Wheels lie: a
skid-steered robot turns by a third more than they say, so the prediction's error grows with each
turn, and how much more it turns is learnt.
"""

import math
from collections import deque

import numpy as np

from onebot_control.navigation.scan_matching import Match, Walls
from onebot_description.arrays import Floats
from onebot_description.geometry.poses import PlanarPose, clamp

_KEPT = 100  # poses of the odometry
_SLIP, _SKID = 0.3, 0.4  # error of a way, m per m, and of a turn by the wheels, rad per rad
_GYRO_SKID = 0.01  # rad per rad, of an IMU
_STILL = 0.004  # m and rad, error of each step
_TRUSTED = 0.4  # share of a scan on walls from which a match counts
_MIN_RATIO, _MAX_RATIO = 0.7, 1.6  # bounds of a turn relative to the wheels' turn
_LEARNT = 0.15  # rad; from such turns between matches it is learnt how wheels lie


def interpolated(start: PlanarPose, end: PlanarPose, share: float) -> PlanarPose:
    """Return the pose at a share, 0 to 1, of the way between two poses."""
    turn = math.remainder(end.yaw - start.yaw, math.tau)
    return PlanarPose(
        start.x + share * (end.x - start.x),
        start.y + share * (end.y - start.y),
        start.yaw + share * turn,
    )


class Localizer:
    """Keeps the robot's pose in the map.

    Attributes:
        covariance: (3, 3), of the pose's x, y and yaw, m and rad.
        share: of the last scan's ends that lay on walls, 0 to 1.
        turn_ratio: by how much more the robot turns than its wheels say.
    """

    def __init__(self, pose: PlanarPose, covariance: Floats | None = None) -> None:
        """Begin at a pose in the map, with its covariance (3, 3); None: it is known exactly."""
        self.place(pose, covariance)
        self.turn_ratio = 1.0
        self._last: PlanarPose | None = None  # pose by the odometry
        self._turned = np.zeros(2)  # absolute sums by wheels and by matches, rad

    def place(self, pose: PlanarPose, covariance: Floats | None = None) -> None:
        """Take the robot to be at a pose, with a covariance (3, 3); None: it is known exactly."""
        self._pose = pose
        least = np.diag([1e-4, 1e-4, 1e-4])  # no pose is exact, even if it is given as such
        self.covariance = least if covariance is None else covariance + least
        self.share = 1.0
        self._history = deque[tuple[float, PlanarPose]](maxlen=_KEPT)
        self._turn = 0.0

    def rebase(self) -> None:
        """Take the next odometry as that of the present pose, as after a jump of it."""
        self._last = None

    @property
    def pose(self) -> PlanarPose:
        """The robot's pose in the map."""
        return self._pose._replace(yaw=math.remainder(self._pose.yaw, math.tau))

    def predict(self, time: float, odometry: PlanarPose, turn: float | None = None) -> None:
        """Move the pose as the odometry has moved.

        Args:
            time: of the odometry, s.
            odometry: pose in the odometry's frame.
            turn: how far an IMU has turned since the last call, rad; None: there is none.
        """
        last, self._last = self._last or odometry, odometry
        motion = last.inverse().compose(odometry)
        by_wheels = math.remainder(motion.yaw, math.tau)
        yaw = by_wheels * self.turn_ratio if turn is None else turn
        distance = math.hypot(motion.x, motion.y)
        # The chord lies at half of the turn.
        bend = (yaw - by_wheels) / 2.0
        cos, sin = math.cos(bend), math.sin(bend)
        motion = PlanarPose(cos * motion.x - sin * motion.y, sin * motion.x + cos * motion.y, yaw)
        former_pose = self._pose
        self._pose = former_pose.compose(motion)
        self._turn += by_wheels
        across = np.eye(3)
        across[0, 2], across[1, 2] = former_pose.y - self._pose.y, self._pose.x - former_pose.x
        skid = _SKID if turn is None else _GYRO_SKID
        moved = bool(distance or yaw)
        error = _SLIP * distance + 0.02 * abs(yaw) + _STILL * moved
        noise = np.diag([error**2, error**2, (skid * abs(yaw) + error) ** 2])
        self.covariance = across @ self.covariance @ across.T + noise
        self._history.append((time, self._pose))

    def at(self, time: float) -> PlanarPose:
        """Return the pose at an earlier time, s."""
        later: tuple[float, PlanarPose] | None = None
        for stamp, pose in reversed(self._history):
            if stamp <= time:
                if later is None or later[0] == stamp:
                    return pose
                return interpolated(pose, later[1], (time - stamp) / (later[0] - stamp))
            later = stamp, pose
        return later[1] if later else self._pose

    def correct(self, time: float, points: Floats, walls: Walls) -> Match:
        """Match a scan to walls, and correct the pose by it.

        Args:
            time: of the scan, s.
            points: ends of its rays in the robot's frame, (N, 2), m.
            walls: the walls of the map.
        """
        predicted = self.at(time)
        match = walls.match(points, predicted, self.covariance)
        self.share = match.share
        if match.share < _TRUSTED:
            return match._replace(pose=predicted)
        self.covariance = match.covariance
        correction = match.pose.compose(predicted.inverse())
        self._learn(match.pose.yaw - predicted.yaw)
        self._pose = correction.compose(self._pose)
        self._history = deque(
            [(stamp, correction.compose(pose)) for stamp, pose in self._history], _KEPT
        )
        return match

    def _learn(self, error: float) -> None:
        """Learn from a match by how much more the robot has turned than predicted, rad."""
        by_wheels, self._turn = self._turn, 0.0
        actual = by_wheels * self.turn_ratio + error
        self._turned = self._turned + (abs(by_wheels), math.copysign(1.0, by_wheels) * actual)
        if self._turned[0] > _LEARNT:
            ratio = self._turned[1] / self._turned[0]
            learnt = self.turn_ratio + 0.2 * (ratio - self.turn_ratio)
            self.turn_ratio = clamp(learnt, _MIN_RATIO, _MAX_RATIO)
            self._turned = np.zeros(2)
