"""Computes positions and velocities of a robot's joints at any time, within their limits.

`ReceivedJointStates` stores joint states from other nodes; `JointStateSource` samples them and the
planned motions of the joints.
"""

import math
from collections.abc import Sequence

import numpy as np

from onebot_description.arrays import Floats
from onebot_description.description import Joint
from onebot_description.joints.config import JointsConfig
from onebot_description.joints.motion_limits import (
    movable,
)
from onebot_description.joints.motions import (
    TURN,
    Motion,
)
from onebot_description.joints.plan import Plan, make_plan
from onebot_description.parameters.reader import ConfigError, Problem
from onebot_description.parameters.values import LARGEST

# A step this much over the limit is rounding; allowing it keeps followers exact.
_ROUNDING = 1e-9


class ReceivedJointStates:
    """The latest state of N joints, received from other nodes; NaN until one is received."""

    def __init__(self, names: Sequence[str]) -> None:
        self._index = {name: number for number, name in enumerate(names)}
        self.values = np.full((3, len(names)), math.nan)
        # (3, N), and each (N,): rad or m, rad/s or m/s, N m or N.
        self.position, self.velocity, self.effort = self.values

    @property
    def kinds(self) -> tuple[bool, bool, bool]:
        """Whether the position, the velocity and the effort of any joint were received."""
        position, velocity, effort = (~np.isnan(self.values)).any(axis=1).tolist()
        return position, velocity, effort

    def receive(
        self,
        names: Sequence[str],
        position: Sequence[float],
        velocity: Sequence[float],
        effort: Sequence[float],
    ) -> str | None:
        """Store the values of one message; if all of it was ignored, return why.

        Each list is as long as ``names``, or empty. Values that are not finite or beyond LARGEST,
        and joints of other robots, are skipped.
        """
        lists = position, velocity, effort
        for what, values in zip(("position", "velocity", "effort"), lists, strict=True):
            if len(values) not in (0, len(names)):
                return f"{len(names)} names but {len(values)} values of {what}"
        for row, values in zip(self.values, lists, strict=True):
            for name, value in zip(names, values, strict=False):
                number = self._index.get(name)
                if number is not None and abs(value) <= LARGEST:
                    row[number] = value
        return None


class JointStateSource:
    """Moves joints as configured, within their position and velocity limits.

    Each sample is the previous one plus its velocity times the time between them. The joints
    start at their zero positions. From there, and from their current positions when the parameters
    change, they move to their targets as fast as their velocity limits allow.

    The positions of continuous joints without followers are wrapped to -pi..pi.
    """

    def __init__(
        self,
        joints: Sequence[Joint],
        config: JointsConfig | None = None,
        *,
        previous: "JointStateSource | None" = None,
        tolerant: bool = False,
    ) -> None:
        """Start at the zero positions, or where joints of the same names are in ``previous``.

        Args:
            joints: all joints of the robot, in the order of the samples; fixed ones are left out.
            config: the parameters; by default no joint moves.
            previous: a source to continue from.
            tolerant: leave out parameters that do not match the joints, and report them, instead
                of raising a ConfigError.
        """
        self._all_joints = tuple(joints)
        self.names = tuple(joint.name for joint in movable(joints))
        self.received = ReceivedJointStates(self.names)
        self._time: float | None = None
        self._elapsed = 0.0
        self._plan = make_plan(joints, config or JointsConfig())
        if self._plan.unsuitable and not tolerant:
            raise ConfigError(self._plan.unsuitable)
        count = len(self.names)
        self._position = self._follow(self._plan.zeros)
        self._velocity = np.zeros(count)
        self._origins = np.zeros(count)
        self._begun: list[Motion | None] = [None] * count
        if previous is not None:
            self._continue_from(previous)
        self.apply(self._plan)

    @property
    def reports(self) -> tuple[Problem, ...]:
        """Warnings on the parameters, such as motions beyond limits."""
        return self._plan.reports

    @property
    def moving(self) -> bool:
        """Whether any joint moved in the last sample."""
        return bool(np.any(self._velocity))

    def prepare(self, config: JointsConfig) -> Plan:
        """Return the plan for new parameters, without applying it.

        Raises ConfigError for parameters that do not match the joints, unless they already apply.
        """
        plan = make_plan(self._all_joints, config)
        tolerated = self._plan.unsuitable
        if new := [problem for problem in plan.unsuitable if problem not in tolerated]:
            raise ConfigError(new)
        return plan

    def apply(self, plan: Plan) -> None:
        """Apply a plan of `prepare`: unchanged motions continue, changed ones start now."""
        self._plan = plan
        changed = np.array(
            [old != new for old, new in zip(self._begun, plan.motions, strict=True)], dtype=bool
        )
        self._begun = list(plan.motions)
        turning = changed & plan.endless
        self._position = np.where(turning, wrapped(self._position), self._position)
        self._origins = np.where(changed, self._elapsed, self._origins)
        # A continuous joint turns the short way to its new target.
        turns = np.round((self._targets() - self._position) / TURN)
        self._position = self._position + np.where(turning, TURN * turns, 0.0)

    def sample(self, time: float) -> tuple[Floats, Floats]:
        """Advance the joints to ``time``.

        Args:
            time: s, of any clock. If it goes backwards, the joints do not move.

        Returns:
            Positions (N,) in rad or m, and velocities (N,) in rad/s or m/s.
        """
        step = 0.0 if self._time is None else time - self._time
        if step != 0.0 or self._time is None:
            self._advance(max(step, 0.0))
        self._time = time
        return self._reported()

    def efforts(self) -> Floats:
        """Return the received efforts (N,) in N m or N; 0 for joints without one."""
        efforts = np.nan_to_num(self.received.effort)
        return np.asarray(efforts[self._plan.following.leader])

    def _advance(self, step: float) -> None:
        self._elapsed += step
        if step <= 0.0:
            self._velocity = np.zeros_like(self._position)
            return
        limits, following = self._plan.limits, self._plan.following
        target = np.clip(self._targets(), limits.lower, limits.upper)
        leading = self._toward(target, step)
        # Followers move to their leaders' new positions; they lag only after a change of leader.
        position = np.where(following.follows, self._toward(self._follow(leading), step), leading)
        velocity = (position - self._position) / step
        self._velocity = np.clip(velocity, -limits.velocity, limits.velocity)
        self._position = position

    def _targets(self) -> Floats:
        """Return the motions' current positions; if one is not finite, the joint stays."""
        times = np.maximum(self._elapsed - self._origins, 0.0).tolist()
        motions = zip(self._plan.motions, times, strict=True)
        positions = np.array([motion.at(time) for motion, time in motions], float)
        return np.where(np.isfinite(positions), positions, self._position)

    def _toward(self, target: Floats, step: float) -> Floats:
        """Move from the current positions to ``target`` as far as the velocity limits allow."""
        way = target - self._position
        reach = self._plan.limits.velocity * step
        near = np.abs(way) <= reach * (1.0 + _ROUNDING)
        return np.where(near, target, self._position + np.clip(way, -reach, reach))

    def _follow(self, leading: Floats) -> Floats:
        following = self._plan.following
        return np.asarray(leading[following.leader] * following.factor + following.offset)

    def _reported(self) -> tuple[Floats, Floats]:
        """Return positions and velocities; received ones override the motions."""
        endless = self._plan.endless
        position = np.where(endless, wrapped(self._position), self._position)
        received, velocity = self.received.position, self._velocity.copy()
        if not any(self.received.kinds[:2]):
            return position, velocity
        following = self._plan.following
        followed = self._follow(received)
        speed = self.received.velocity[following.leader] * following.factor
        is_given = ~np.isnan(followed)
        position = np.where(is_given, followed, position)
        velocity = np.where(is_given | ~np.isnan(speed), np.nan_to_num(speed), velocity)
        return position, velocity

    def _continue_from(self, previous: "JointStateSource") -> None:
        """Copy positions, motions and received states of the joints that both have."""
        self._time, self._elapsed = previous._time, previous._elapsed
        index = {name: number for number, name in enumerate(previous.names)}
        pairs = [(i, index[name]) for i, name in enumerate(self.names) if name in index]
        for mine, theirs in pairs:
            self._position[mine] = previous._position[theirs]
            self._origins[mine] = previous._origins[theirs]
            self._begun[mine] = previous._begun[theirs]
            self.received.values[:, mine] = previous.received.values[:, theirs]


def wrapped(angle: Floats) -> Floats:
    """Return angles wrapped to -pi..pi, in rad; those in range are unchanged."""
    beyond = np.abs(angle) > math.pi
    return np.asarray(np.where(beyond, np.remainder(angle + math.pi, TURN) - math.pi, angle))
