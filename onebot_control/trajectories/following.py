"""Follows trajectories like joint_trajectory_controller. It does not use ROS.

Example:
    >>> from onebot_control.trajectories.config import TrajectoryConfig
    >>> from onebot_control.trajectories.following import TrajectoryFollower
    >>> from onebot_control.trajectories.goal import FollowedJoint, TrajectoryGoal
    >>> from onebot_control.trajectories.trajectory import JointMotion, Waypoint
    >>> follower = TrajectoryFollower([FollowedJoint("elbow")], TrajectoryConfig(), [0.0])
    >>> follower.start(TrajectoryGoal(("elbow",), (Waypoint(2.0, (0.5,)),)), token="mine")
    >>> measured = JointMotion((0.0,), (0.0,), ())  # rad, rad/s
    >>> follower.update(measured, now=0, period=0.01)  # once per control cycle
    []
    >>> follower.reference(1.0)  # the position to command 1 s later, rad
    [0.25]
"""

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Sequence
from functools import partial
from operator import add, sub
from typing import Any, ClassVar, NamedTuple

from onebot_control.trajectories.arrival import Arrival
from onebot_control.trajectories.config import (
    MAX_SCALING,
    JointControllerConfig,
    TrajectoryConfig,
)
from onebot_control.trajectories.goal import (
    FollowedJoint,
    MotorLimits,
    TrajectoryGoal,
    goal_problems,
)
from onebot_control.trajectories.tolerances import (
    TolerancesGiven,
    default_tolerances,
    exceeded,
    resolved_tolerances,
)
from onebot_control.trajectories.trajectory import (
    JointMotion,
    Trajectory,
    Waypoint,
    braking,
    integrated,
    standstill,
)
from onebot_description.errors import OneBotError
from onebot_description.geometry.poses import clamp
from onebot_description.timing import NS_PER_S

CANCELLED = 1  # the client has cancelled the goal; not a code of control_msgs
SUCCESSFUL = 0
INVALID_GOAL = -1
PATH_TOLERANCE_VIOLATED = -4
GOAL_TOLERANCE_VIOLATED = -5
# Texts of outcomes, as in joint_trajectory_controller.
PREEMPTED = "Current goal preempted by new incoming action."
REPLACED = "Current goal preempted by another trajectory, which is not an action goal."
RESET = "Current goal cancelled by a reset."
ROUNDING = 1e-9  # s; maximum rounding error of a sum of periods


class Outcome(NamedTuple):
    """The outcome of an action goal or of a trajectory from the topic."""

    goal: object | None  # the token given to ``start``; None: no action goal was active
    code: int  # code of control_msgs/FollowJointTrajectory or CANCELLED; 0: success, < 0: aborted
    text: str  # joint_trajectory_controller's wording
    detail: str = ""  # the joint beyond its tolerance, with its position error


class JointFollower(ABC):
    """Moves the joints of one controller, cycle by cycle; each type of controller has a subclass.

    Attributes:
        parameters: dataclass of the controller's parameters.
        joints: the joints, with their limits.
        names: the names of these joints.
        active: the token of the current action goal; None if there is none.
    """

    parameters: ClassVar[type[JointControllerConfig]]
    active: Any = None

    def __init__(
        self, joints: Sequence[FollowedJoint], config: Any, positions: Sequence[float]
    ) -> None:
        """Hold the joints at their current positions.

        Args:
            joints: the joints, with their limits.
            config: the controller's parameters, an instance of ``parameters``.
            positions: current positions of the joints, rad or m.
        """
        self.joints = tuple(joints)
        self.names = tuple(joint.name for joint in joints)
        self.configure(config)
        self.reset(positions)

    def configure(self, config: Any) -> None:
        """Apply changed parameters."""
        self._config = config

    @property
    def motor_limits(self) -> MotorLimits | None:
        """Additional limits of the joints' motors from the last update on; None for none."""
        return None

    @abstractmethod
    def update(self, measured: JointMotion, now: int, period: float) -> list[Outcome]:
        """Run one control cycle; see ``TrajectoryFollower.update``."""

    @abstractmethod
    def reference(self, ahead: float) -> Sequence[float]:
        """Return the positions to command ``ahead`` seconds after the last update, rad or m."""

    @abstractmethod
    def cancel(self) -> None:
        """Cancel the goal, and stop."""

    @abstractmethod
    def abort(self, text: str) -> Outcome | None:
        """Hold the joints; abort an action goal with ``text`` as the reason; return its outcome."""

    @abstractmethod
    def reset(self, positions: Sequence[float]) -> Outcome | None:
        """Hold ``positions``, rad or m, to which the joints were set; abort an action goal."""

    def _ended(self, text: str) -> Outcome | None:
        """Abort the goal, and return its outcome; None if there was none."""
        goal, self.active = self.active, None
        return None if goal is None else Outcome(goal, INVALID_GOAL, text)


class TrajectoryFollower(JointFollower):
    """Follows trajectories of some joints, and holds the joints without a trajectory.

    It does not read a clock: each cycle has a stamp, and a trajectory's time advances by the
    cycles' periods times ``scaling``. With enforce_command_limits, positions are clamped to the
    joints' limits where splines overshoot between two points, or where a motion starts beyond them.

    Attributes:
        desired: the reference at the last update; continuous joints keep the goal's whole turns.
        measured: measured motion at the last update.
        error: position errors at the last update, desired - measured, rad or m; for continuous
            joints the shortest angle.
        time: trajectory time at the last update, s since its start; negative before the start.
        elapsed: seconds of cycles since the start; above ``time`` if the scaling is below 1.
        stalled: joints that could not reach the last goal; see ``Arrival``.
    """

    parameters = TrajectoryConfig
    time: float
    _config: TrajectoryConfig
    _holding: bool
    # Called in the next update, with measured motion and stamp, to start a trajectory.
    _next: Callable[[JointMotion, int], None] | None
    _start_stamp: int | None  # trajectory start, ns; unknown until its first update

    def __init__(
        self,
        joints: Sequence[FollowedJoint],
        config: TrajectoryConfig,
        positions: Sequence[float],
    ) -> None:
        """Hold the joints at their current positions; see ``JointFollower``."""
        super().__init__(joints, config, positions)
        self._tolerances = self._defaults
        self.scaling = config.speed_scaling.initial_scaling_factor
        self._now, self._advance, self._rate = 0, 0.0, self.scaling

    def configure(self, config: TrajectoryConfig) -> None:
        """Apply changed parameters; new tolerances apply from the next action goal on."""
        constraints = config.joint_constraints(self.names)
        super().configure(config)
        self._defaults = default_tolerances(constraints, config)
        self._bounds = [
            (joint.lower, joint.upper) if config.enforce_command_limits else (-math.inf, math.inf)
            for joint in self.joints
        ]
        self._decelerations = [joint.max_deceleration_on_cancel for joint in constraints]

    @property
    def scaling(self) -> float:
        """Trajectory seconds per second of cycles, from the next update on; 0 to MAX_SCALING.

        Setting another value raises OneBotError.
        """
        return self._scaling

    @scaling.setter
    def scaling(self, value: float) -> None:
        if not 0.0 <= value <= MAX_SCALING:
            raise OneBotError(f"a speed scaling must be 0 to {MAX_SCALING:g}, not {value:g}")
        self._scaling = value

    @property
    def moving(self) -> bool:
        """Whether a joint of a goal is neither at its goal nor stalled."""
        return self._next is not None or self._arrival is not None

    # Goals ------------------------------------------------------------------------------------

    def problems(self, goal: TrajectoryGoal, now: int) -> list[str]:
        """Return why ``goal`` is rejected at time ``now``, ns, one line per reason."""
        return goal_problems(goal, self.joints, self._config, now)

    def start(
        self,
        goal: TrajectoryGoal,
        token: object | None = None,
        tolerances: TolerancesGiven | None = None,
        from_command: Collection[str] = (),
        *,
        absolute: bool = False,
    ) -> Outcome | None:
        """Follow a goal from the next update on, instead of the current one.

        Args:
            goal: the trajectory; ``problems`` must have found none.
            token: identifies an action goal in ``active`` and in its outcome; None for a trajectory
                that is not an action goal, such as a message of the topic.
            tolerances: tolerances of an action goal; None for the defaults.
            from_command: joints that start at rest from their last command, so that a finger that
                presses on something keeps pressing; the others start with their measured motion.
            absolute: whether continuous joints move to the given positions, by whole turns if
                necessary; otherwise they take the shortest path to the first one, as in
                joint_trajectory_controller.

        Returns:
            The outcome of the replaced action goal; None if there is none.
        """
        self._next = partial(self._follow_goal, goal, from_command, absolute)
        preempted = self._ended(REPLACED if token is None else PREEMPTED)
        self.active = token
        if token is not None:
            self._tolerances = resolved_tolerances(
                tolerances or TolerancesGiven(), self.names, self._defaults
            )
        return preempted

    def cancel(self) -> None:
        """Cancel the goal; the next update holds the measured position, or decelerates from it."""
        self.active = None
        self._next = self._stop

    def abort(
        self, text: str = "Current goal cancelled during deactivate transition."
    ) -> Outcome | None:
        """Abort an action goal and hold the last command, as if deactivated and activated again.

        If set_last_command_interface_value_as_state_on_activation is false, the measured position
        of the next update is held instead.
        """
        if self._config.set_last_command_interface_value_as_state_on_activation:
            self._hold(self._command().positions)
        else:
            self._next = lambda measured, now: self._hold(measured.positions)
        return self._ended(text)

    def reset(self, positions: Sequence[float]) -> Outcome | None:
        """Hold ``positions``, rad or m, to which the joints were set; abort an action goal."""
        self._hold(positions)
        zeros = (0.0,) * len(self.joints)
        self.desired = self.measured = JointMotion(tuple(positions), zeros, zeros)
        self.error = zeros
        return self._ended(RESET)

    # Cycles -----------------------------------------------------------------------------------

    def update(self, measured: JointMotion, now: int, period: float) -> list[Outcome]:
        """Run one control cycle, before the joints move for ``period`` seconds.

        Args:
            measured: current motion of the joints; empty accelerations are computed from the
                velocities, if state_interfaces include them.
            now: stamp of the cycle, ns.
            period: seconds until the next cycle.

        Returns:
            Outcomes of the goals that ended in this cycle.
        """
        if "acceleration" in self._config.state_interfaces and not measured.accelerations:
            changes = map(sub, measured.velocities, self.measured.velocities)
            measured = measured._replace(accelerations=tuple(dv / period for dv in changes))
        self.measured = measured
        begin = self._next
        if begin is None:
            self.time += self._advance
        else:
            begin(measured, now)
        if self._start_stamp is None:
            self._start_stamp = now - round(self.time * NS_PER_S)
        self.elapsed = (now - self._start_stamp) / NS_PER_S
        self._rate = self._scaling
        self._advance = period * self._rate
        self._now = now
        self.desired = self._limited(self._trajectory.sample(self.time))
        self.error = self._errors()
        if self._arrival is not None and self.time >= self._trajectory.end - ROUNDING:
            self._judge_arrival(self._arrival, period)
        return [] if self._holding else self._judged(first=begin is not None)

    def reference(self, ahead: float) -> list[float]:
        """Return the positions to command ``ahead`` seconds after the last update, rad or m.

        Continuous joints keep the whole turns of the measured positions, so they may differ from
        ``desired`` by whole turns.
        """
        positions = self._trajectory.sample(self.time + ahead * self._rate).positions
        return [
            clamp(position + turns, lower, upper)
            for position, turns, (lower, upper) in zip(
                positions, self._turns, self._bounds, strict=True
            )
        ]

    def query(self, time: int) -> JointMotion:
        """Return the desired motion at ``time``, ns, assuming that the scaling does not change.

        Raises:
            OneBotError: no trajectory is followed at that time.
        """
        if self._holding:
            raise OneBotError("Currently there is no valid trajectory instance.")
        trajectory_time = self.time + (time - self._now) / NS_PER_S * self._rate
        if trajectory_time < self._first_time:
            text = "Requested sample time is earlier than the current trajectory start time."
            raise OneBotError(text)
        if trajectory_time >= self._trajectory.end:
            text = "Requested sample time is later than the current trajectory end time."
            raise OneBotError(text)
        return self._limited(self._trajectory.sample(trajectory_time))

    def _limited(self, motion: JointMotion) -> JointMotion:
        """Return ``motion`` with joints beyond their limits at rest at the limit."""
        joints = [*zip(*motion, self._bounds, strict=True)]
        if all(lower <= position <= upper for position, _, _, (lower, upper) in joints):
            return motion
        states = [
            (p, v, a) if lower <= p <= upper else (clamp(p, lower, upper), 0.0, 0.0)
            for p, v, a, (lower, upper) in joints
        ]
        return JointMotion(*zip(*states, strict=True))

    def _errors(self) -> tuple[float, ...]:
        positions = zip(self.desired.positions, self.measured.positions, strict=True)
        return tuple(
            math.remainder(desired - measured, math.tau) if joint.continuous else desired - measured
            for joint, (desired, measured) in zip(self.joints, positions, strict=True)
        )

    # Trajectories -----------------------------------------------------------------------------

    def _follow(
        self,
        trajectory: Trajectory,
        time: float = 0.0,
        turns: Sequence[float] | None = None,
        *,
        holding: bool = True,
    ) -> None:
        """Follow ``trajectory`` from ``time`` on; if ``holding``, tolerances are not checked."""
        self._next = None
        self._trajectory = trajectory
        self.time = self._first_time = self.elapsed = time
        self._start_stamp = None
        self._turns = turns or (0.0,) * len(self.joints)
        self._holding = holding
        self._arrival: Arrival | None = None
        self.stalled: tuple[str, ...] = ()

    def _hold(self, positions: Sequence[float]) -> None:
        self._follow(standstill(positions))

    def _stop(self, measured: JointMotion, now: int) -> None:
        """Hold the measured position, or decelerate from it."""
        brakes = (
            self._config.constraints.decelerate_on_cancel
            and "velocity" in self._config.state_interfaces
            and all(self._decelerations)
        )
        if brakes:
            self._follow(braking(measured, self._decelerations))
        else:
            self._hold(measured.positions)

    def _follow_goal(
        self,
        goal: TrajectoryGoal,
        from_command: Collection[str],
        absolute: bool,
        measured: JointMotion,
        now: int,
    ) -> None:
        """Follow ``goal`` from the joints' motion; see ``start``."""
        start = self._command() if self._config.begins_at_command else self.state
        if from_command:
            start = self._with_commands(start, from_command)
        time = (now - goal.stamp) / NS_PER_S if goal.stamp else 0.0
        points = integrated(Waypoint(time, *start), self._points(goal))
        turns: tuple[float, ...] = (0.0,) * len(self.joints)
        if not absolute and goal.points[0].positions:
            target = Trajectory(points[0], points).sample(time)
            turns = self._turns_between(target.positions, start.positions)
        positions = tuple(p - turn for p, turn in zip(start.positions, turns, strict=True))
        trajectory = Trajectory(
            Waypoint(time, positions, start.velocities, start.accelerations),
            points,
            splines=self._config.interpolation_method == "splines",
        )
        self._follow(trajectory, time, turns, holding=False)
        self._arrival = Arrival(goal.joints)

    def _command(self) -> JointMotion:
        """Return the last command: the reference at the end of the last cycle."""
        motion = self._limited(self._trajectory.sample(self.time + self._advance))
        positions = map(add, motion.positions, self._turns)
        return motion._replace(positions=tuple(positions))

    @property
    def state(self) -> JointMotion:
        """The part of the measured motion that state_interfaces include."""
        interfaces, measured = self._config.state_interfaces, self.measured
        return JointMotion(
            measured.positions,
            measured.velocities if "velocity" in interfaces else (),
            measured.accelerations if "acceleration" in interfaces else (),
        )

    def _with_commands(self, start: JointMotion, names: Collection[str]) -> JointMotion:
        """Return ``start`` with the joints ``names`` at rest at their last command."""
        zeros = (0.0,) * len(self.joints)
        states = zip(*(values or zeros for values in start), strict=True)
        joints = zip(self.names, self._command().positions, states, strict=True)
        changed = [(at, 0.0, 0.0) if name in names else state for name, at, state in joints]
        return JointMotion(*zip(*changed, strict=True))

    def _turns_between(
        self, positions: Sequence[float], others: Sequence[float]
    ) -> tuple[float, ...]:
        """Return the whole turns, rad, from continuous joints at ``positions`` to ``others``."""
        return tuple(
            math.tau * round((target - position) / math.tau) if joint.continuous else 0.0
            for joint, position, target in zip(self.joints, positions, others, strict=True)
        )

    def _points(self, goal: TrajectoryGoal) -> Sequence[Waypoint]:
        """Return the goal's points for all joints, in their order; missing joints are held."""
        if goal.joints == self.names:
            return goal.points
        command = dict(zip(self.names, self._command().positions, strict=True))
        missing = [name for name in self.names if name not in goal.joints]
        places = {name: place for place, name in enumerate((*goal.joints, *missing))}
        order = [places[name] for name in self.names]
        held, zeros = [command[name] for name in missing], [0.0] * len(missing)

        def completed(values: Sequence[float], others: Sequence[float]) -> tuple[float, ...]:
            every = (*values, *others)
            return tuple(every[place] for place in order) if values else ()

        return [
            Waypoint(
                point.time,
                completed(point.positions, held),
                completed(point.velocities, zeros),
                completed(point.accelerations, zeros),
            )
            for point in goal.points
        ]

    # Arrival ----------------------------------------------------------------------------------

    def _judge_arrival(self, arrival: Arrival, period: float) -> None:
        """Stop monitoring ``arrival`` once each joint is at its goal or stalled."""
        present = zip(self.names, self.reference(0.0), self.measured.positions, strict=True)
        errors = {name: command - position for name, command, position in present}
        velocities = dict(zip(self.names, self.measured.velocities, strict=True))
        if arrival.update(errors, velocities, period):
            self.stalled, self._arrival = arrival.stalled, None

    # Tolerances -------------------------------------------------------------------------------

    def _judged(self, *, first: bool) -> list[Outcome]:
        """Compare the error with the tolerances.

        Tolerances of the path apply before the last point, and always in the ``first`` cycle.
        """
        late = self.time - self._trajectory.end
        moving = late < -ROUNDING
        detail = exceeded(self.names, self.error, self._tolerances.path)
        if (moving or first) and detail:
            text = "Aborted due to path tolerance violation"
            topic = "Holding position due to state tolerance violation"
            return self._failed(PATH_TOLERANCE_VIOLATED, text, topic, detail)
        return [] if moving else self._judged_at_end(late)

    def _judged_at_end(self, late: float) -> list[Outcome]:
        """Compare the error with the goal's tolerances, ``late`` seconds after the last point."""
        detail = exceeded(self.names, self.error, self._tolerances.goal)
        if self.active is not None and not detail:
            goal, self.active = self.active, None
            self._holding = True
            return [Outcome(goal, SUCCESSFUL, "Goal successfully reached!")]
        goal_time, timeout = self._tolerances.goal_time, self._config.timeout
        if detail and 0.0 < goal_time < late - ROUNDING:
            text = f"Aborted due to goal_time_tolerance exceeding by {late:f} seconds"
            topic = "Exceeded goal_time_tolerance: holding position..."
            return self._failed(GOAL_TOLERANCE_VIOLATED, text, topic, detail)
        if 0.0 < timeout < late - ROUNDING:
            text = "Aborted due to command timeout"
            return self._failed(GOAL_TOLERANCE_VIOLATED, text, text, detail)
        return []

    def _failed(self, code: int, text: str, topic: str, detail: str) -> list[Outcome]:
        """Stop, and return the outcome; ``topic`` is its text if no action goal is active."""
        goal, self.active = self.active, None
        self._stop(self.measured, self._now)
        return [Outcome(goal, code, topic if goal is None else text, detail)]
