"""Trajectories of joints: piecewise polynomials through waypoints.

Example:
    >>> from onebot_control.trajectories.trajectory import Trajectory, Waypoint
    >>> points = [Waypoint(1.0, (1.0,)), Waypoint(2.0, (2.0,))]
    >>> trajectory = Trajectory(Waypoint(0.0, (0.5,)), points)
    >>> motion = trajectory.sample(0.5)
    >>> motion.positions, motion.velocities  # rad, rad/s
    ((0.75,), (0.5,))
"""

from bisect import bisect_right
from collections.abc import Callable, Sequence
from typing import NamedTuple

# Coefficients of a joint's polynomial in the seconds since the segment start, constant term first.
_Coefficients = tuple[float, float, float, float, float, float]


class Waypoint(NamedTuple):
    """One point of a trajectory: values per joint in rad (m for prismatic joints) and seconds."""

    time: float  # time_from_start, s
    positions: tuple[float, ...]  # one per joint of the trajectory; empty: see ``integrated``
    velocities: tuple[float, ...] = ()  # empty: not given
    accelerations: tuple[float, ...] = ()  # empty: not given


class JointMotion(NamedTuple):
    """The state of joints at one moment, in rad (m for prismatic joints) and seconds."""

    positions: tuple[float, ...]
    velocities: tuple[float, ...]
    accelerations: tuple[float, ...]


class Trajectory:
    """A trajectory from a start through waypoints, interpolated as in joint_trajectory_controller.

    A segment is linear unless both of its ends have velocities: then it is cubic, or quintic if
    both also have accelerations. Accelerations without velocities are ignored. The last point is
    held.

    Attributes:
        end: the time of the last point, s.
    """

    def __init__(
        self, start: Waypoint, points: Sequence[Waypoint], *, splines: bool = True
    ) -> None:
        """Interpolate from ``start`` through ``points``.

        Args:
            start: the initial motion; its time may be negative. It is ignored if the first point
                is not later. Derivatives that only the first point has are 0 at the start.
            points: one or more, in ascending order of time.
            splines: False for steps: the start is held until the time of the first point, and at
                the time of each point the motion jumps to the next one.
        """
        lead_in = [_completed(start, points[0])] if start.time < points[0].time else []
        self._waypoints = [*lead_in, *points]
        self._times = [waypoint.time for waypoint in self._waypoints]
        # Waypoints that are held, not interpolated, by segment; the last one is held forever.
        self._held = {len(self._waypoints) - 1: points[-1]}
        if not splines:
            self._held |= dict(enumerate([*lead_in, *points[1:]]))
        self._segments: dict[int, list[_Coefficients]] = {}
        self.end = points[-1].time

    def sample(self, time: float) -> JointMotion:
        """Return the motion at ``time``, s; before the start, the motion at the start."""
        index = self._index(time)
        if held := self._held.get(index):
            zeros = (0.0,) * len(held.positions)
            return JointMotion(
                held.positions, held.velocities or zeros, held.accelerations or zeros
            )
        elapsed = max(0.0, time - self._times[index])
        states = [_evaluated(joint, elapsed) for joint in self._segment(index)]
        return JointMotion(*zip(*states, strict=True))

    def _index(self, time: float) -> int:
        return max(0, bisect_right(self._times, time) - 1)

    def _segment(self, index: int) -> list[_Coefficients]:
        """Return the polynomials of a segment, one per joint."""
        # They are computed when first needed: for a long trajectory, computing all of them at once
        # would take longer than a control cycle.
        if index not in self._segments:
            self._segments[index] = _interpolated(*self._waypoints[index : index + 2])
        return self._segments[index]


def _completed(start: Waypoint, point: Waypoint) -> Waypoint:
    """Return ``start`` with zeros for derivatives that only ``point`` has."""
    zeros = (0.0,) * len(start.positions)
    return start._replace(
        velocities=start.velocities or (zeros if point.velocities else ()),
        accelerations=start.accelerations or (zeros if point.accelerations else ()),
    )


def integrated(start: Waypoint, points: Sequence[Waypoint]) -> list[Waypoint]:
    """Return ``points`` with positions; missing ones are derived as in joint_trajectory_controller.

    Velocities and accelerations are integrated from point to point with the trapezoidal rule;
    missing ones at the start of a segment are 0.

    Args:
        start: the motion before the first point.
        points: the points; those without positions have velocities or accelerations.
    """
    earlier, completed = start, list[Waypoint]()
    for point in points:
        if not point.positions:
            duration, zeros = point.time - earlier.time, (0.0,) * len(earlier.positions)
            begin = earlier._replace(velocities=earlier.velocities or zeros)
            if not point.velocities:
                begin = begin._replace(accelerations=earlier.accelerations or zeros)
                accelerations = begin.accelerations, point.accelerations
                point = point._replace(velocities=_sum(begin.velocities, *accelerations, duration))
            velocities = begin.velocities, point.velocities
            point = point._replace(positions=_sum(begin.positions, *velocities, duration))
            if completed and begin != earlier:
                completed.append(begin)  # at the same time; only this segment has these zeros
        completed.append(point)
        earlier = point
    return completed


def _sum(
    values: Sequence[float], rates: Sequence[float], end_rates: Sequence[float], duration: float
) -> tuple[float, ...]:
    """Return values after ``duration`` seconds, with the trapezoidal rule."""
    rows = zip(values, rates, end_rates, strict=True)
    return tuple(value + 0.5 * (rate + end_rate) * duration for value, rate, end_rate in rows)


def _interpolated(start: Waypoint, end: Waypoint) -> list[_Coefficients]:
    """Return the polynomials from ``start`` to ``end``, for the derivatives of both."""
    duration = end.time - start.time
    columns = [start.positions, end.positions]
    polynomial: Callable[..., _Coefficients] = _linear
    if start.velocities and end.velocities:
        columns += [start.velocities, end.velocities]
        polynomial = _cubic
        if start.accelerations and end.accelerations:
            columns += [start.accelerations, end.accelerations]
            polynomial = _quintic
    return [polynomial(*values, duration) for values in zip(*columns, strict=True)]


def _linear(p: float, q: float, duration: float) -> _Coefficients:
    """Return the line from position ``p`` to ``q``."""
    return (p, (q - p) / duration, 0.0, 0.0, 0.0, 0.0)


def _cubic(p: float, q: float, v: float, w: float, duration: float) -> _Coefficients:
    """Return the cubic from position ``p`` and velocity ``v`` to ``q`` and ``w`` (Hermite)."""
    # Relative to a motion at constant velocity v, the end is reached if
    #   distance = c2 T^2 + c3 T^3,  change = (2 c2 T + 3 c3 T^2) T.
    distance, change = q - p - v * duration, (w - v) * duration
    square = duration * duration
    return (
        p,
        v,
        (3.0 * distance - change) / square,
        (change - 2.0 * distance) / (square * duration),
        0.0,
        0.0,
    )


def _quintic(
    p: float, q: float, v: float, w: float, a: float, b: float, duration: float
) -> _Coefficients:
    """Return the quintic from ``p``, velocity ``v``, acceleration ``a`` to ``q``, ``w``, ``b``."""
    # Relative to a motion at constant acceleration a, the end is reached if
    #   distance = c3 T^3 + c4 T^4 + c5 T^5,  change = T times its derivative,
    #   bend = T^2 / 2 times its second derivative.
    square = duration * duration
    distance = q - p - v * duration - 0.5 * a * square
    change = (w - v) * duration - a * square
    bend = 0.5 * (b - a) * square
    cube = square * duration
    return (
        p,
        v,
        0.5 * a,
        (10.0 * distance - 4.0 * change + bend) / cube,
        (-15.0 * distance + 7.0 * change - 2.0 * bend) / (cube * duration),
        (6.0 * distance - 3.0 * change + bend) / (cube * square),
    )


def _evaluated(coefficients: _Coefficients, t: float) -> tuple[float, float, float]:
    """Return position, velocity and acceleration ``t`` seconds into a segment (Horner)."""
    c0, c1, c2, c3, c4, c5 = coefficients
    return (
        ((((c5 * t + c4) * t + c3) * t + c2) * t + c1) * t + c0,
        (((5.0 * c5 * t + 4.0 * c4) * t + 3.0 * c3) * t + 2.0 * c2) * t + c1,
        ((20.0 * c5 * t + 12.0 * c4) * t + 6.0 * c3) * t + 2.0 * c2,
    )


def standstill(positions: Sequence[float]) -> Trajectory:
    """Return the trajectory that holds ``positions`` from time 0 on."""
    point = Waypoint(0.0, tuple(positions))
    return Trajectory(point, [point])


def braking(motion: JointMotion, decelerations: Sequence[float]) -> Trajectory:
    """Return the trajectory that stops each joint with a constant deceleration, from time 0 on.

    A joint with velocity v stops after t = |v| / deceleration seconds, at a distance of v t / 2.

    Args:
        motion: the motion to stop.
        decelerations: decelerations of the joints, above 0, rad/s2 or m/s2.
    """
    durations = [abs(v) / a for v, a in zip(motion.velocities, decelerations, strict=True)]
    # Between two times at which a joint comes to rest, each joint's cubic is its parabola.
    points = [_slowed(motion, durations, time) for time in sorted({0.0, *durations})]
    return Trajectory(points[0], points)


def _slowed(motion: JointMotion, durations: Sequence[float], time: float) -> Waypoint:
    """Return the motion at ``time`` of joints that come to rest after ``durations``, s."""
    positions, velocities = [], []
    for p, v, duration in zip(motion.positions, motion.velocities, durations, strict=True):
        braked = min(time, duration)
        left = 1.0 - braked / duration if duration else 0.0  # remaining share of the velocity
        positions.append(p + 0.5 * v * (1.0 + left) * braked)
        velocities.append(v * left)
    return Waypoint(time, tuple(positions), tuple(velocities))
