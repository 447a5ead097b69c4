"""The pose of the robot in the map: its odometry, corrected by scan matching.

The odometry, with the heading from an IMU if there is one, predicts the motion since the last scan,
which is then matched to the walls of the map. Wheel odometry is biased in turns: a skid-steered
robot may turn a third more than its wheels indicate. The error of the prediction therefore grows
with each turn, and the ratio is learnt.
"""

import math

import numpy as np

from onebot_control.navigation.scan_matching import Walls
from onebot_description.arrays import Floats
from onebot_description.geometry.poses import PlanarPose, clamp

_KEPT = 100  # number of remembered odometry poses
_SLIP, _SKID = 0.3, 0.4  # odometry error of a distance, m per m, and of a turn, rad per rad
_GYRO_SKID = 0.01  # error of a turn by an IMU, rad per rad
_STILL = 0.004  # m and rad, error of each step
_TRUSTED = 0.4  # minimum share of a scan on walls for a valid match
_MIN_RATIO, _MAX_RATIO = 0.7, 1.6  # bounds of the actual turn relative to the odometry's
_LEARNT = 0.15  # rad of turning between two updates of the learnt ratio


class Localizer:
    """Estimates the robot's pose in the map.

    Attributes:
        covariance: (3, 3), of the pose's x, y and yaw, m and rad.
        turn_ratio: ratio of the robot's actual turn to the odometry's.
    """

    def __init__(self, pose: PlanarPose, covariance: Floats | None = None) -> None:
        """Start at a pose in the map, with its covariance (3, 3); None: it is exact."""
        self.place(pose, covariance)
        self.turn_ratio = 1.0
        self._last: PlanarPose | None = None  # pose of the odometry
        self._turned = np.zeros(2)  # absolute sums from wheels and from matches, rad

    def place(self, pose: PlanarPose, covariance: Floats | None = None) -> None:
        """Set the pose, with its covariance (3, 3); None: it is exact."""
        self._pose = pose
        minimum = np.diag([1e-4, 1e-4, 1e-4])  # no given pose is really exact
        self.covariance = minimum if covariance is None else covariance + minimum
        self._history = np.zeros((0, 4))  # times, s, and poses
        self._turn = 0.0

    def rebase(self) -> None:
        """Take the next odometry as that of the current pose, after the odometry has jumped."""
        self._last = None

    @property
    def pose(self) -> PlanarPose:
        """The robot's pose in the map."""
        return self._pose._replace(yaw=math.remainder(self._pose.yaw, math.tau))

    def predict(self, time: float, odometry: PlanarPose, turn: float | None = None) -> None:
        """Apply the motion of the odometry to the pose.

        Args:
            time: time of the odometry, s.
            odometry: pose in the odometry frame.
            turn: turn measured by an IMU since the last call, rad; None: there is no IMU.
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
        self._history = np.append(self._history, [(time, *self._pose)], axis=0)[-_KEPT:]

    def at(self, time: float) -> PlanarPose:
        """Return the pose at an earlier time, s."""
        times, *parts = self._history.T
        return PlanarPose(*(float(np.interp(time, times, part)) for part in parts))

    def correct(self, time: float, points: Floats, walls: Walls) -> None:
        """Match a scan to walls, and correct the pose.

        Args:
            time: time of the scan, s.
            points: end points of its rays in the robot's frame, (N, 2), m.
            walls: the walls of the map.
        """
        predicted = self.at(time)
        match = walls.match(points, predicted, self.covariance)
        if match.share < _TRUSTED:
            return
        self.covariance = match.covariance
        correction = match.pose.compose(predicted.inverse())
        self._learn(match.pose.yaw - predicted.yaw)
        self._pose = correction.compose(self._pose)
        self._history[:, 1:] = np.array(correction.compose(PlanarPose(*self._history.T[1:]))).T

    def _learn(self, error: float) -> None:
        """Update ``turn_ratio`` with the error of the predicted heading, rad."""
        by_wheels, self._turn = self._turn, 0.0
        actual = by_wheels * self.turn_ratio + error
        self._turned = self._turned + (abs(by_wheels), math.copysign(1.0, by_wheels) * actual)
        if self._turned[0] > _LEARNT:
            ratio = self._turned[1] / self._turned[0]
            learnt = self.turn_ratio + 0.2 * (ratio - self.turn_ratio)
            self.turn_ratio = clamp(learnt, _MIN_RATIO, _MAX_RATIO)
            self._turned = np.zeros(2)
