"""One robot of a ``Simulation``: its commands, state and measurements."""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from onebot_control.controlled_robot import ControlledRobot
from onebot_control.drive.drive import Drive
from onebot_control.drive.wheels.geometry import WheelGeometry
from onebot_control.physics.contacts import Contact
from onebot_control.physics.engine import logger
from onebot_control.robot_setup import Parameters, given_parameters
from onebot_control.sensing.instrument import Instrument
from onebot_control.sensing.lidar import LidarInstrument, angles
from onebot_control.sensing.rays import Rays
from onebot_control.sensing.readings import (
    ByName,
    ImuReading,
    JointState,
    OdometryReading,
    RobotPose,
    Scan,
)
from onebot_control.simulated_navigation import SimulatedNavigation
from onebot_control.simulation_core import SimulationCore
from onebot_control.trajectories.following import TrajectoryFollower
from onebot_control.trajectories.goal import TrajectoryGoal
from onebot_control.trajectories.trajectory import Waypoint
from onebot_description.description import Description
from onebot_description.errors import OneBotError, did_you_mean, listing
from onebot_description.geometry.poses import PlanarPose, PlanarVelocity
from onebot_description.parameters.arguments import checked_methods
from onebot_description.parameters.values import Rule, ValueType
from onebot_description.timing.throttled import Throttled

_AHEAD = Rays(np.array([[1.0, 0.0, 0.0]]))  # along the x axis

Duration = Annotated[
    float, Rule(at_least=0.0, at_most=1e12, write="a duration that is finite and not negative, s")
]
Vector = Annotated[
    Sequence[float], ValueType(float, Rule(write="three finite numbers: x, y, z"), True, 3)
]
Positive = Annotated[float, Rule(above=0.0)]
_Positions = Annotated[Mapping[str, float], Rule(write="a dict of positions by joint")]


@checked_methods(before=lambda self: self._core.require_open())
class SimulatedRobot:
    """One robot of a Simulation: takes commands, and returns its true state and measurements."""

    def __init__(self, core: Callable[[], SimulationCore], row: int) -> None:
        """Take the robot ``row`` of a world, which ``core`` returns; see ``Simulation.robots``."""
        self._present_core, self._row, self._name = core, row, core().names[row]
        self._navigation = SimulatedNavigation(core, row)
        self._warn = Throttled(logger.warning)

    def drive(self, linear: float, angular: float = 0.0, *, lateral: float = 0.0) -> None:
        """Command a velocity; it holds until the next call, as if sent in every cycle.

        From then on, commands from ROS nodes in lockstep have no effect. The controller limits
        speed and acceleration: OneBot accelerates by 0.5 m/s^2, so it takes 1 s to reach 0.5 m/s.
        A car turns as far as its steering allows; a warning that this is less is logged once.

        Args:
            linear: forward, m/s.
            angular: turning to the left, rad/s.
            lateral: to the left, m/s, for mecanum and omni drives.

        Raises:
            ValueError: a velocity is not finite.
            OneBotError: the robot has no wheels, or cannot move sideways.
        """
        if lateral and not self._drive.moves_sideways:
            raise OneBotError("the robot's drive does not move sideways: leave lateral out")
        fault = self._drive.odometry.kinematics.fault((linear, lateral, angular))
        if fault and self._core.publish is None:  # otherwise the robot's node logs it
            self._warn.once(fault)
        self.navigation.cancel("drive took over")
        self._core.commands[self._row] = linear, lateral, angular

    def go_to(self, x: float, y: float, yaw: float | None = None) -> None:
        """Drive to a point in the world, around obstacles, while the simulation runs.

        The robot navigates with its own scans, odometry and IMU, if it has one; it builds a map,
        and knows only where it started. ``navigating`` is true until the goal is reached within
        5 cm, or given up; then ``navigation.status`` is "arrived" or "failed", and
        ``navigation.reason`` says why. ``drive`` cancels the goal; another call replaces it.

        Args:
            x: x coordinate of the root link in the world, m.
            y: y coordinate of the root link in the world, m.
            yaw: heading there in the world, rad; None for any. A robot that cannot turn on the spot
                arrives with any heading.

        Raises:
            ValueError: a number is not finite.
            OneBotError: the robot has no wheels, no lidar that is level, or no shape.
        """
        self.navigation.go_to(x, y, yaw)

    @property
    def navigating(self) -> bool:
        """Whether the robot is driving to a goal of ``go_to``."""
        return self.navigation.navigating

    @property
    def navigation(self) -> SimulatedNavigation:
        """The navigation that drives the robot to goals, with its status and its map."""
        return self._navigation

    @property
    def path(self) -> NDArray[np.float64]:
        """The current path to the goal of ``go_to``.

        Returns:
            (N, 2), points in the world, m, from the robot to the goal; N = 0 without a goal.
        """
        return self.navigation.path

    def move_to(self, positions: _Positions, *, seconds: Positive) -> None:
        """Move joints to ``positions``, where they come to rest after ``seconds``.

        They start in the next control cycle and follow a quintic polynomial that begins with their
        current velocity; another call replaces it. Other joints hold their commanded positions, so
        fingers that grip something keep gripping it. Joints that are too slow arrive later:
        ``moving`` is true until they arrive, or cannot arrive; see ``stalled``.

        Args:
            positions: target by joint name, rad (m for prismatic joints); a continuous joint may
                make whole turns.
            seconds: simulated duration, above 0.

        Raises:
            OneBotError: no controller commands a joint, or a position is not finite or beyond the
                joint's limits; nothing moves.
        """
        stamp = self._core.fleet.stamp
        followers = self._trajectories
        owners = {joint: name for name, follower in followers.items() for joint in follower.names}
        for joint in positions:
            if joint not in owners:
                raise OneBotError(f'no joint "{joint}" is commanded{did_you_mean(joint, owners)}')
        problems, goals = list[str](), dict[str, TrajectoryGoal]()
        for controller in dict.fromkeys(owners[joint] for joint in positions):
            follower = followers[controller]
            moved = {name: positions[name] for name in follower.names if name in positions}
            present = dict(zip(follower.names, follower.reference(0.0), strict=True))
            problems += follower.problems(_goal({**present, **moved}, seconds), stamp)
            goals[controller] = _goal(moved, seconds)
        if problems:
            raise OneBotError("\n".join(problems))
        for controller, goal in goals.items():
            follower = followers[controller]
            held = set(follower.names) - set(positions)
            replaced = follower.start(goal, from_command=held, absolute=True)
            self._controlled.finish(controller, [replaced])

    @property
    def moving(self) -> bool:
        """Whether joints are still moving to a goal of ``move_to`` or of a ROS node.

        A joint has arrived when it rests within 1e-4 rad or m. It cannot arrive if, after the end
        of the motion, it rests elsewhere for a second, or comes no nearer for five seconds.
        """
        return any(follower.moving for follower in self._trajectories.values())

    @property
    def stalled(self) -> Sequence[str]:
        """The joints that could not reach their last goal: blocked, or too weak; see ``moving``.

        Fingers that grip something are among them.
        """
        return [name for follower in self._trajectories.values() for name in follower.stalled]

    @property
    def _trajectories(self) -> dict[str, TrajectoryFollower]:
        followers = self._controlled.followers.items()
        return {
            name: follower
            for name, follower in followers
            if isinstance(follower, TrajectoryFollower)
        }

    def teleport(self, x: float, y: float, yaw: float = 0.0) -> None:
        """Move the robot to another pose in the world, at rest; its odometry does not change.

        Args:
            x: x coordinate of the root link in the world, m.
            y: y coordinate of the root link in the world, m.
            yaw: heading in the world, rad.

        Raises:
            OneBotError: something is in the way, or a value is not finite; nothing has changed.
        """
        self._controlled.teleport(PlanarPose(x, y, yaw))
        self._core.moved(self._row)
        self.navigation.place(PlanarPose(x, y, yaw))

    @property
    def contacts(self) -> Sequence[Contact]:
        """The contacts of the robot in the last control cycle, in any of its physics steps.

        It is empty after a reset or a teleport, until the next cycle. All contact points of two
        links are listed, at their last positions; their forces add up to the mean over the cycle.
        """
        return self._core.contacts(self._row)

    @property
    def collided(self) -> bool:
        """Whether it has touched anything but its support since it was placed.

        The start, a reset and a teleport place it. Its support is whatever carries its base, wheels
        and casters from below; for links that arms move, the ground is also an obstacle.
        """
        return self._core.fleet.world.contacts.collided[self._row]

    def push(
        self,
        force: Vector,
        seconds: Duration,
        *,
        link: str = "",
        point: Vector | None = None,
    ) -> None:
        """Push the robot for some time, from the next cycle on; several pushes add up.

        Args:
            force: (3,), in the world's axes, N.
            seconds: simulated duration, rounded to whole physics steps; a reset or a teleport of
                the robot ends it.
            link: the link to push; "" for the root link.
            point: (3,), point of application in the link's frame, m; None for the center of mass of
                the link and the links fixed to it.

        Raises:
            ValueError: a number is not finite, or the duration is negative.
            OneBotError: there is no such link, or it is fixed.
        """
        at = None if point is None else np.array(point, float)
        link = link or self.description.root_link
        world = self._core.fleet.world
        world.push(self._controlled.body, link, at, np.array(force, float), seconds)

    def set_joints(self, positions: _Positions) -> None:
        """Set joints to ``positions`` instantly, at rest; their controllers hold them there.

        Joints that mimic them follow; other joints and the base continue. Use ``move_to`` to move
        joints with their motors.

        Args:
            positions: position by joint name, rad (m for prismatic joints).

        Raises:
            OneBotError: a joint cannot be set, a position is not finite or beyond the joint's
                limits, or the robot would overlap something; nothing has changed.
        """
        self._controlled.set_joints(positions)
        self._core.moved(self._row)

    def set_parameters(self, parameters: Parameters) -> None:
        """Change parameters of the controller from the next cycle on; a reset undoes it.

        Args:
            parameters: values by their ROS names, such as ``linear.x.max_velocity``.

        Raises:
            ConfigError: a value is wrong, or is read only at the start; nothing has changed.
            OneBotError: ROS nodes are in lockstep: the robot's node has the parameters.
        """
        core = self._core
        if core.publish is not None:
            text = "ROS nodes are in lockstep with the simulation"
            raise OneBotError(f"{text}: set the parameters of the robot's node")
        values = given_parameters(parameters, type(self._controlled.config))
        core.configure(self._row, {**core.parameters[self._row], **values})

    @property
    def description(self) -> Description:
        """The robot's description: its links, joints and sensors as read from the URDF."""
        return self._controlled.description

    @property
    def has_wheels(self) -> bool:
        """Whether the robot drives on wheels; otherwise its base is fixed."""
        return self._controlled.drive is not None

    @property
    def wheel_separation(self) -> float:
        """Distance between the wheels of a differential drive, m: the parameter, or from the URDF.

        Raises:
            OneBotError: the robot has no wheels, or another kind of drive.
        """
        geometry = self._drive.geometry
        if not isinstance(geometry, WheelGeometry):
            raise OneBotError(f"the robot has no differential drive, but {geometry}")
        return geometry.separation

    @property
    def wheel_radius(self) -> float:
        """Radius of the driven wheels, m: the parameter, or the value from the URDF."""
        return float(self._drive.geometry.radius)

    @property
    def pose(self) -> RobotPose:
        """The true pose of the robot's root link in the world."""
        return RobotPose.of(self._controlled.snapshot().pose)

    @property
    def twist(self) -> PlanarVelocity:
        """The true velocity of the robot's root link, in its own axes."""
        linear, angular = self._controlled.snapshot().velocity
        return PlanarVelocity(linear[0], linear[1], angular[2])

    @property
    def odometry(self) -> OdometryReading:
        """Pose and velocity from wheel odometry."""
        (x, y, yaw), covariances, (linear, lateral, angular), *_ = self._drive.state(
            self._controlled.pace.value
        )
        xx, xy, yy, xt, yt, tt = covariances
        covariance = ((xx, xy, xt), (xy, yy, yt), (xt, yt, tt))
        yaw = math.remainder(yaw, math.tau)
        return OdometryReading(x, y, yaw, linear, angular, covariance, lateral)

    @property
    def command(self) -> PlanarVelocity:
        """The limited velocity that the controller set in the last cycle, as in ~/cmd_vel_out."""
        return PlanarVelocity(*self._drive.command[:3])

    @property
    def joints(self) -> Mapping[str, JointState]:
        """The states of the moving joints, by name; an unknown name raises OneBotError."""
        states = zip(*self._controlled.snapshot().joint_states, strict=True)
        readings = (JointState(*state) for state in states)
        return ByName("no joint {} can move", zip(self._controlled.joints, readings, strict=True))

    def scan(self, sensor: str = "") -> Scan:
        """Measure with a lidar now, regardless of its rate.

        Args:
            sensor: name of the lidar; may be omitted if there is only one.

        Returns:
            The ranges in the lidar's plane, in the lidar's frame; for a 3D lidar, those of its
            middle row.

        Raises:
            OneBotError: there is no such lidar, or there are several.
        """
        lidar = self._instrument("scan", sensor).model
        ranges = self._measured("scan", sensor)
        return Scan(ranges, angles(lidar.horizontal), lidar.range_min, lidar.range_max)

    def range(self, sensor: str = "") -> float:
        """Measure with a range sensor now, regardless of its rate.

        Args:
            sensor: name of the range sensor; may be omitted if there is only one.

        Returns:
            The distance from the sensor's frame, m; infinite if nothing is in range, minus infinity
            if something is too near (REP-117).

        Raises:
            OneBotError: there is no such sensor, or there are several.
        """
        return float(self._measured("range", sensor))

    def image(self, sensor: str = "") -> NDArray[np.uint8]:
        """Take a picture with a camera now, regardless of its rate.

        Args:
            sensor: name of the camera; may be omitted if there is only one.

        Returns:
            (height, width, 3), RGB, the topmost row first.

        Raises:
            OneBotError: there is no such camera, or there are several.
        """
        pixels: NDArray[np.uint8] = self._measured("image", sensor)
        return pixels

    def depth(self, sensor: str = "") -> NDArray[np.float32]:
        """Measure with a depth camera now, regardless of its rate.

        Args:
            sensor: name of the depth camera; may be omitted if there is only one.

        Returns:
            (height, width), distances along the camera's axis, m; infinite where nothing is in
            range, minus infinity where something is too near (REP-117).

        Raises:
            OneBotError: there is no such camera, or there are several.
        """
        depths: NDArray[np.float32] = self._measured("depth", sensor)
        return depths

    def points(self, sensor: str = "") -> NDArray[np.float32]:
        """Measure the points that a lidar or a depth camera sees now, regardless of its rate.

        Args:
            sensor: name of the lidar or camera; may be omitted if there is only one.

        Returns:
            (N, 3), in the frame of the sensor's messages, m; rays that hit nothing yield no point.

        Raises:
            OneBotError: there is no such sensor, or there are several.
        """
        cloud = self._measured("points", sensor).ravel()
        xyz: NDArray[np.float32] = np.stack([cloud[axis] for axis in "xyz"], axis=-1)
        return xyz[np.isfinite(xyz).all(axis=1)]

    def imu(self, sensor: str = "") -> ImuReading:
        """Measure with an inertial measurement unit (IMU) now, regardless of its rate.

        Args:
            sensor: name of the IMU; may be omitted if there is only one.

        Returns:
            Its orientation, and angular velocity (rad/s) and acceleration (m/s^2) in its own axes.

        Raises:
            OneBotError: there is no such IMU, or there are several.
        """
        orientation, *vectors = self._measured("imu", sensor)
        return ImuReading(None if orientation is None else np.array(orientation), *vectors)

    def distance_ahead(self) -> float:
        """Return the exact distance to the first thing ahead, m; infinite if there is none.

        It is measured along the x axis of the lidar, or of the root link if there is no lidar. It
        ignores the robot itself, and has no noise and no maximum range.
        """
        placed = self._core.sensed().placed
        instruments = self._core.instruments[self._row]
        lidars = [item for item in instruments if isinstance(item, LidarInstrument)]
        pose = lidars[0].pose(placed) if lidars else None
        pose = pose or placed.link(self._row, self.description.root_link)
        assert pose is not None
        links = self.description.link_names
        own_links = [placed.surroundings.target(self._row, link) for link in links]
        return self._core.distance(pose, _AHEAD, own_links)

    def __repr__(self) -> str:
        pose = self.pose
        x, y, yaw = (round(value, 3) + 0.0 for value in (pose.x, pose.y, pose.yaw))
        return f"{self._name or 'robot'} at x {x:.3f} m, y {y:.3f} m, yaw {yaw:.3f} rad"

    @property
    def _drive(self) -> Drive:
        """The robot's drive; raises OneBotError for a fixed base."""
        if (drive := self._controlled.drive) is None:
            raise OneBotError(
                f"{self.description.source}: the robot has no wheels to drive on: no continuous "
                "joint turns a round shape on the ground about a lateral axis"
            )
        return drive

    @property
    def _core(self) -> SimulationCore:
        """The current world, which a reset may replace."""
        return self._present_core()

    @property
    def _controlled(self) -> ControlledRobot:
        return self._core.fleet.robots[self._row]

    def _instrument(self, output: str, name: str) -> Instrument[Any]:
        instruments = self._core.instruments[self._row]
        able = {item.sensor.name: item for item in instruments if output in item.sensor.topics}
        if not name and len(able) == 1:
            return next(iter(able.values()))
        if name not in able:
            text = f"name a sensor that measures {output}: {listing(able)}"
            if not instruments:
                text += "; Simulation(sensors=True) gives OneBot its sensors"
            raise OneBotError(text)
        return able[name]

    def _measured(self, output: str, sensor: str) -> Any:
        """Measure one output now, with a named sensor or the only one that has this output."""
        instrument = self._instrument(output, sensor)
        return instrument.measure(self._core.sensed(), {output})[output]


def _goal(positions: Mapping[str, float], seconds: float) -> TrajectoryGoal:
    """Return a goal at which joints rest after ``seconds``."""
    zeros = (0.0,) * len(positions)
    point = Waypoint(seconds, tuple(map(float, positions.values())), zeros, zeros)
    return TrajectoryGoal(tuple(positions), (point,))
