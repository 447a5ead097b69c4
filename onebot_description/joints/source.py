"""Positions and velocities of a robot's joints at any moment, always within their limits."""

import math
from collections.abc import Sequence

import numpy as np

from onebot_description.description import Description, JointSpec
from onebot_description.joints.config import JointsConfig
from onebot_description.joints.feedback import Feedback
from onebot_description.joints.limits import FloatArray, SoftLimits, movable, soft_limits
from onebot_description.joints.motions import Motion
from onebot_description.joints.plan import Plan, make_plan
from onebot_description.joints.problems import Problem
from onebot_description.joints.tracks import Tracks

_TURN = 2.0 * math.pi
# A step this much over the limit is rounding, and taking it whole keeps followers exact.
_ROUNDING = 1e-9


class JointStateSource:
    """Moves joints as its parameters say, never faster nor further than their limits.

    Each sample is the one before plus the velocity it reports times the time between the two. The
    joints start at their zero positions and go from there, and from wherever they are when the
    parameters change, to what the motion asks, as fast as their velocity limits let them.

    A continuous joint that no other follows is reported within -pi and pi.
    """

    def __init__(
        self,
        joints: Sequence[JointSpec],
        config: JointsConfig | None = None,
        *,
        soft: SoftLimits | None = None,
        previous: "JointStateSource | None" = None,
    ) -> None:
        """Start from the zero positions, or from where ``previous`` has got to.

        Args:
            joints: all joints of the robot, in the order wanted; those that do not move are left
                out.
            config: what they do; by default they stand still.
            soft: joint name to (lower, upper) soft limits.
            previous: a source whose joints of the same names this one takes over, as they are.

        Raises:
            ConfigError: the parameters or the limits make no sense.
        """
        self._all_joints = tuple(joints)
        self._soft: SoftLimits = dict(soft or {})
        self._joints = movable(joints)
        self.names = tuple(joint.name for joint in self._joints)
        self.feedback = Feedback(self.names)
        self._time: float | None = None
        self._elapsed = 0.0
        self._plan = self.prepare(config or JointsConfig())
        count = len(self.names)
        self._position = self._follow(self._plan.zeros)
        self._velocity = np.zeros(count)
        self._origins, self._starts = np.zeros(count), self._position.copy()
        self._begun: list[Motion | None] = [None] * count
        if previous is not None:
            self._take_over(previous)
        self.apply(self._plan)

    @classmethod
    def from_description(
        cls,
        description: Description,
        config: JointsConfig | None = None,
        *,
        previous: "JointStateSource | None" = None,
    ) -> "JointStateSource":
        """Return a source for the joints of ``description``, its soft limits included."""
        soft = soft_limits(description.urdf)
        return cls(description.joints, config, soft=soft, previous=previous)

    @property
    def config(self) -> JointsConfig:
        """The parameters in force."""
        return self._plan.config

    @property
    def reports(self) -> tuple[Problem, ...]:
        """What the parameters ask beyond limits, and other remarks."""
        return self._plan.reports

    @property
    def moving(self) -> bool:
        """Whether any joint moved in the last sample."""
        return bool(np.any(self._velocity))

    def prepare(self, config: JointsConfig) -> Plan:
        """Check parameters against the robot, and change nothing.

        Raises:
            ConfigError: with the problems found.
        """
        return make_plan(self._all_joints, self._soft, config)

    def configure(self, config: JointsConfig) -> tuple[Problem, ...]:
        """Take up new parameters from here on, and return the reports on them.

        Motions that stay the same go on; changed ones begin now.

        Raises:
            ConfigError: with the problems found; the old parameters stay in force.
        """
        self.apply(self.prepare(config))
        return self.reports

    def apply(self, plan: Plan) -> None:
        """Take up a prepared plan from here on."""
        self._plan = plan
        changed = np.array(
            [old != new for old, new in zip(self._begun, plan.motions, strict=True)], dtype=bool
        )
        self._begun = list(plan.motions)
        turning = changed & plan.endless
        self._position = np.where(turning, wrapped(self._position), self._position)
        self._origins = np.where(changed, self._elapsed, self._origins)
        self._starts = np.where(changed, self._position, self._starts)
        self._tracks = Tracks(plan.motions, self._origins, self._starts, plan.endless)
        # A joint without end takes the short way to its new motion.
        turns = np.round((self._tracks.at(self._elapsed) - self._position) / _TURN)
        self._position = self._position + np.where(turning, _TURN * turns, 0.0)

    def sample(self, time: float) -> tuple[FloatArray, FloatArray]:
        """Move on to ``time``.

        Args:
            time: s, of any clock. Should it go backwards, the joints stay where they are.

        Returns:
            Positions (N,) in rad or m, and velocities (N,) in rad/s or m/s.
        """
        step = 0.0 if self._time is None else time - self._time
        if step != 0.0 or self._time is None:
            self._advance(max(step, 0.0))
        self._time = time
        return self._reported()

    def efforts(self) -> FloatArray:
        """Return the efforts (N,) in N m or N: those the feedback gave, else 0."""
        known = np.nan_to_num(self.feedback.effort)
        return np.asarray(known[self._plan.following.leader])

    def _advance(self, step: float) -> None:
        self._elapsed += step
        if step <= 0.0:
            self._velocity = np.zeros_like(self._position)
            return
        limits, following = self._plan.limits, self._plan.following
        asked = np.clip(self._tracks.at(self._elapsed), limits.lower, limits.upper)
        leading = self._toward(asked, step)
        # Followers step on from the leaders' new positions; they lag only when it has just been
        # decided whom they follow.
        position = np.where(following.follows, self._toward(self._follow(leading), step), leading)
        velocity = (position - self._position) / step
        self._velocity = np.clip(velocity, -limits.velocity, limits.velocity)
        self._position = position

    def _toward(self, target: FloatArray, step: float) -> FloatArray:
        """Go from the present positions to ``target`` as far as the velocity limits let."""
        way = target - self._position
        reach = self._plan.limits.velocity * step
        near = np.abs(way) <= reach * (1.0 + _ROUNDING)
        return np.where(near, target, self._position + np.clip(way, -reach, reach))

    def _follow(self, leading: FloatArray) -> FloatArray:
        following = self._plan.following
        return np.asarray(leading[following.leader] * following.factor + following.offset)

    def _reported(self) -> tuple[FloatArray, FloatArray]:
        """Put the feedback, where there is any, in the place of our own positions."""
        endless = self._plan.endless
        position = np.where(endless, wrapped(self._position), self._position)
        heard, velocity = self.feedback.position, self._velocity.copy()
        if not (self.feedback.any or self.feedback.any_velocity):
            return position, velocity
        following = self._plan.following
        known = ~np.isnan(heard[following.leader])
        speed = self.feedback.velocity[following.leader] * following.factor
        position = np.where(known, self._follow(heard), position)
        velocity = np.where(known | ~np.isnan(speed), np.nan_to_num(speed), velocity)
        return position, velocity

    def _take_over(self, previous: "JointStateSource") -> None:
        """Go on from the positions, motions and feedback of the joints both have."""
        self._time, self._elapsed = previous._time, previous._elapsed
        index = {name: number for number, name in enumerate(previous.names)}
        pairs = [(i, index[name]) for i, name in enumerate(self.names) if name in index]
        for mine, theirs in pairs:
            self._position[mine] = previous._position[theirs]
            self._origins[mine] = previous._origins[theirs]
            self._starts[mine] = previous._starts[theirs]
            self._begun[mine] = previous._begun[theirs]
        self.feedback.take_over(previous.feedback, pairs)


def wrapped(angle: FloatArray) -> FloatArray:
    """Return angles within -pi and pi, in rad; those already there are unchanged."""
    beyond = np.abs(angle) > math.pi
    return np.asarray(np.where(beyond, angle - _TURN * np.round(angle / _TURN), angle))
