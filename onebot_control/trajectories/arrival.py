"""Determines whether joints have reached their goals, or cannot reach them. It does not use ROS.

A joint cannot reach its goal if it stands still elsewhere for a second of simulated time, like a
finger that presses on something, or if its error does not decrease for five seconds, for example if
its motor is too weak to lift it. The maximum errors of each second are compared, so a joint with
decaying oscillations about its goal can reach it, and so can a joint that is late because of its
velocity limit.

Example:
    >>> from onebot_control.trajectories.arrival import Arrival
    >>> arrival = Arrival(["elbow", "finger"])
    >>> errors, velocities = {"elbow": 0.0, "finger": 0.01}, {"elbow": 0.0, "finger": 0.0}
    >>> sum(not arrival.update(errors, velocities, period=0.01) for _ in range(300))
    100
    >>> arrival.stalled
    ('finger',)
"""

import math
from collections.abc import Mapping, Sequence

_NEAR = 1e-4  # rad or m, maximum error of a joint at its goal
_STILL = 1e-3  # rad/s or m/s, maximum velocity of a joint at its goal
_WINDOW = 1.0  # s; a joint that moves less than _NEAR within it stands still
_PATIENCE = 5  # number of windows without a smaller maximum error until a joint counts as stalled
_ROUNDING = 1e-9  # s; maximum rounding error of a sum of periods


class Arrival:
    """Monitors joints after the end of their trajectory until each is at its goal or stalled."""

    def __init__(self, joints: Sequence[str]) -> None:
        """Monitor the joints with these names."""
        self._progress = {name: _Progress() for name in joints}
        self._elapsed = 0.0  # s since the start of the current window

    @property
    def stalled(self) -> tuple[str, ...]:
        """The joints that cannot reach their goals."""
        return tuple(name for name, joint in self._progress.items() if joint.stalled)

    def update(
        self, errors: Mapping[str, float], velocities: Mapping[str, float], period: float
    ) -> bool:
        """Run one control cycle.

        Args:
            errors: goal minus position of each joint, by name, rad or m.
            velocities: velocity of each joint, by name, rad/s or m/s.
            period: seconds until the next cycle.

        Returns:
            Whether each joint is at its goal, or stalled.
        """
        ends_window = self._elapsed > _WINDOW - _ROUNDING
        self._elapsed = period if ends_window else self._elapsed + period
        for name, joint in self._progress.items():
            if ends_window:
                joint.end_window()
            joint.add(errors[name])
        return all(
            joint.stalled or (abs(errors[name]) <= _NEAR and abs(velocities[name]) <= _STILL)
            for name, joint in self._progress.items()
        )


class _Progress:
    """The progress of a joint towards its goal."""

    def __init__(self) -> None:
        self.stalled = False
        self._best = math.inf  # the smallest of the windows' maximum errors, rad or m
        self._waited = 0  # number of windows since then
        self._low, self._high = math.inf, -math.inf  # range of the errors in the current window

    def add(self, error: float) -> None:
        self._low, self._high = min(self._low, error), max(self._high, error)

    def end_window(self) -> None:
        """Evaluate the window that ends now, and start the next one."""
        maximum = max(-self._low, self._high)
        stands = self._high - self._low < _NEAR
        self._waited = 0 if maximum < self._best - _NEAR else self._waited + 1
        self._best = min(self._best, maximum)
        self.stalled = maximum > _NEAR and (stands or self._waited >= _PATIENCE)
        self._low, self._high = math.inf, -math.inf
