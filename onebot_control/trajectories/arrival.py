"""Whether joints are at their goals, or cannot get there. No ROS here.

A joint cannot get there if it stands still elsewhere for a second of simulated time, as a finger
that presses on something does, or if it comes no nearer for five seconds: it swings, because its
motor is too weak to lift it. "Nearer" compares the maximum error in each second with those before,
so a joint that swings about its goal less and less can get there, and so can one that is late
because of its velocity limit.

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

_NEAR = 1e-4  # rad or m; at its goal, a joint has at most this error,
_STILL = 1e-3  # rad/s or m/s; and at most this velocity
_WINDOW = 1.0  # s; a joint that moves less than _NEAR within it stands still
_PATIENCE = 5  # windows without a smaller maximum error, until a joint cannot get there
_ROUNDING = 1e-9  # s; maximum rounding error of a sum of periods


class Arrival:
    """Follows joints from the end of their trajectory until each is there or cannot get there."""

    def __init__(self, joints: Sequence[str]) -> None:
        """Follow the joints with these names."""
        self._progress = {name: _Progress() for name in joints}
        self._elapsed = 0.0  # s since the current window began

    @property
    def stalled(self) -> tuple[str, ...]:
        """The joints that cannot get there."""
        return tuple(name for name, joint in self._progress.items() if joint.stalled)

    def update(
        self, errors: Mapping[str, float], velocities: Mapping[str, float], period: float
    ) -> bool:
        """Run one control cycle.

        Args:
            errors: goal minus position of each joint by its name, rad or m.
            velocities: its velocity, rad/s or m/s.
            period: seconds until the next cycle.

        Returns:
            Whether each joint is at its goal, or cannot get there.
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
    """How near to its goal a joint has come."""

    def __init__(self) -> None:
        self.stalled = False
        self._best = math.inf  # the smallest of the windows' maximum errors, rad or m
        self._waited = 0  # windows since then
        self._least, self._most = math.inf, -math.inf  # errors in the current window

    def add(self, error: float) -> None:
        self._least, self._most = min(self._least, error), max(self._most, error)

    def end_window(self) -> None:
        """Judge the window that ends now, and begin the next one."""
        greatest = max(-self._least, self._most)
        stands = self._most - self._least < _NEAR
        self._waited = 0 if greatest < self._best - _NEAR else self._waited + 1
        self._best = min(self._best, greatest)
        self.stalled = greatest > _NEAR and (stands or self._waited >= _PATIENCE)
        self._least, self._most = math.inf, -math.inf
