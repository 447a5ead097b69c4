"""Drives a robot to goals.

``Navigator.update`` is called with odometry and scans, and returns velocity commands. It maintains
the map and the robot's pose in it, plans, follows the plan, waits when something blocks the path,
recovers, and gives up with a reason. It reads no clock and does not import ROS, so it works in a
simulation, in a node on a real robot and with a bag.

Example:
    >>> from onebot_control.navigation.footprint import Vehicle
    >>> from onebot_control.navigation.navigator import Navigator
    >>> from onebot_description.geometry.poses import PlanarPose
    >>> square = np.array([(-0.1, -0.1), (0.1, -0.1), (0.1, 0.1), (-0.1, 0.1)])
    >>> navigator = Navigator(Vehicle(square, 0.5, 0.2, 0.0, 2.0, 1.0, 3.0), PlanarPose())
    >>> navigator.go_to(1.0, 0.5)
    >>> navigator.status
    'driving'
    >>> navigator.cancel()
    >>> navigator.status, navigator.reason
    ('cancelled', 'the goal was cancelled')
"""

import math
from enum import Enum
from typing import NamedTuple

import numpy as np

from onebot_control.navigation.cost_to_go import CostToGo
from onebot_control.navigation.costmap import Costmap
from onebot_control.navigation.footprint import Vehicle
from onebot_control.navigation.grid import GridMap, LevelScan, Mask, Window, placed
from onebot_control.navigation.latency import Latency
from onebot_control.navigation.local_planner import LocalPlanner, Situation
from onebot_control.navigation.localization import Localizer
from onebot_control.navigation.parameters import NavigationParameters
from onebot_control.navigation.scan_matching import Walls
from onebot_control.occupancy_grid import OccupancyGrid
from onebot_description.arrays import Floats
from onebot_description.errors import OneBotError
from onebot_description.geometry.poses import PlanarPose, Triple, clamp

_STOP: Triple = (0.0, 0.0, 0.0)
_OLDEST_SCAN = 0.3  # s
_WALLS_EVERY = 4  # scans between two updates of the walls for scan matching
_WALLS_REACH = 8.0  # m
_BEYOND = 6.0  # cost up to which the field is computed beyond the robot
_SLICE = 30_000  # cells of the initial field computed in one update
_REPAIR_EVERY = 0.2  # s between repairs of the field
_BARRED = 20.0  # s of visits added to a place where the robot got stuck
_JUMP = 0.2  # m or rad by which odometry may exceed the possible motion of the robot
_RESET = 0.01  # m from the origin within which odometry after a jump counts as reset
_EXACT = 0.01  # m or rad, tolerance of a motion
_MARGIN = 0.01  # m of margin on either side of the robot in a gap
_SOON = 30  # cells of the path for the local planner
_AROUND = 2.5  # m of the map around start and goal
_OWN = 0.02  # m around the footprint in which a scan measures the robot itself
_PATIENCE = 2.0  # s to wait while something blocks the path
_FORGETS = 4.0  # s without a path until what has moved is forgotten
_HOPELESS = 6.0  # s without a path until the goal fails
_STUCK = 5.0  # s without motion after which the robot is stuck
_MOVED = 0.15  # m, or three times as many rad, that count as motion
_RECOVERIES = 6  # maximum number of recoveries without progress between them
_NEAR_GOAL = 0.4  # m
_SLIGHT_TURN = 0.1  # rad, for which there is room everywhere
_STAGES = 50  # number of places to turn that are tried
_STAGED = 1.0  # m from the goal at which it is known whether the robot can turn there
_EASY = 0.7  # share of the maximum speed from which the robot can stop
_SETTLING = 0.5  # s to stand still while scans find again what was forgotten
_CLEARED = 1.5  # m around the robot in which a recovery clears obstacles


class Failure(Enum):
    """The reason why a goal was not reached, with the names of Nav2's error codes."""

    GOAL_OCCUPIED = "the goal is in an obstacle, or too close to one"
    GOAL_OUTSIDE_MAP = "the goal is outside of the map"
    START_OCCUPIED = "the start is in an obstacle, or too close to one"
    NO_VALID_PATH = "there is no path to the goal"
    FAILED_TO_MAKE_PROGRESS = "the robot is stuck"
    TIMEOUT = "it took longer than allowed"
    COLLISION_AHEAD = "something is in the way"
    INVALID_PATH = "the path is empty or not finite"
    NO_VIAPOINTS_GIVEN = "there is no pose"


class NavigationError(OneBotError):
    """No plan was found, because of ``failure``."""

    def __init__(self, failure: Failure) -> None:
        """Store the failure."""
        super().__init__(failure.value)
        self.failure = failure


class _Goal(NamedTuple):
    """A pose to drive to, in the map."""

    x: float
    y: float
    yaw: float | None
    path: Floats | None = None  # points of a preferred path, (N, 2), m
    is_staged: bool = False  # whether it is known where the robot can turn to the heading
    end: tuple[float, float] | None = None  # the goal itself, if the robot has to turn before, m
    is_straight: bool = False  # whether the robot has turned before


class _Motion(NamedTuple):
    """A straight motion, or a turn on the spot, from the robot's pose when it starts."""

    length: float  # m, or rad to the left; negative: backward, or to the right
    speed: float  # m/s or rad/s, at least 0
    turns: bool


class Navigator:
    """Drives one robot.

    Attributes:
        vehicle: the robot's footprint and limits.
        map: the map, built from scans, or a given one updated by scans.
        localizer: estimates the robot's pose in the map.
        status: "idle", "driving", "blocked", "recovering", "arrived", "cancelled" or "failed".
        reason: one sentence about the status, or "".
        failure: why the last goal failed; None if it has not failed.
        recoveries: number of recoveries for this goal.
        time: time of the last odometry, s.
        speed: last velocity forward, to the left, m/s, and turning to the left, rad/s.
        traveled: distance or angle of ``drive_straight`` or ``spin`` so far, m or rad, at least 0.
    """

    def __init__(
        self,
        vehicle: Vehicle,
        start: PlanarPose,
        *,
        parameters: NavigationParameters | None = None,
        known: OccupancyGrid | None = None,
    ) -> None:
        """Start without a goal.

        Args:
            vehicle: the robot.
            start: its pose in the map.
            parameters: the parameters of navigation.
            known: a given map; None to build one from scans.
        """
        self.parameters = parameters or NavigationParameters()
        self.localizer = Localizer(start)
        self.vehicle, self._given = vehicle, known
        self.status, self.reason = "idle", ""
        self.failure: Failure | None = None
        self._goal: _Goal | _Motion | None = None
        self.time, self.speed, self.traveled, self.recoveries = 0.0, _STOP, 0.0, 0
        self._repeats = 0  # updates without newer odometry
        self._odometry: PlanarPose | None = None
        self.clear()

    def use_map(self, known: OccupancyGrid) -> None:
        """Localize in another map from now on."""
        self._given = known
        self.clear()

    def clear(self) -> None:
        """Clear what scans have added; a given map is kept."""
        given = self._given
        self.map = GridMap.of(given) if given else GridMap(self.parameters.resolution)
        self._walls = Walls(self.map.walls())
        self._scans = 0
        self._scanned: float | None = None
        self.use_vehicle(self.vehicle)

    def forget_near(self, radius: float) -> None:
        """Forget obstacles within ``radius``, m, of the robot, except those of the last scan."""
        self._forget(self.map.around(self.pose, radius))

    def _forget(self, window: Window, cells: Mask | bool = True) -> None:
        """Forget obstacles in a part of the map, except those of the last scan.

        Those beside the robot are kept, since scans do not measure there.
        """
        near = self.map.around(self.pose, self.vehicle.radius + 2.0 * self.map.resolution)
        former = self.map.log_odds[near.cells].copy()
        self.map.doubt(window, cells)
        rows, columns = np.indices(former.shape).reshape(2, -1)
        centers = self.map.middle(rows + near.top, columns + near.left)
        beside = self._is_own(placed(centers, self.pose.inverse()), self.map.resolution)
        beside = beside.reshape(former.shape)
        self.map.log_odds[near.cells][beside] = former[beside]
        if self._scanned is not None:
            window = window.union(self.map.enter(*self._entered))
        self._update_costs(window)
        self._settled = self.time + _SETTLING

    def use_vehicle(self, vehicle: Vehicle) -> None:
        """Use another footprint or other limits of the robot from now on."""
        self.vehicle = vehicle
        period = 1.0 / self.parameters.controller_frequency
        self._local_planner = LocalPlanner(vehicle, period)
        self._latency = Latency(vehicle, period)
        self._circles = vehicle.circles()
        # The best path may run between the centers of cells.
        self._radius = vehicle.half_width + _MARGIN - 0.25 * self.map.resolution
        self._costmap = Costmap(self.map, self._radius)
        if self.map.log_odds.size:
            self._costmap.update(self.map.whole)
        self._field: CostToGo | None = None
        self._changed: Window | None = None  # part of the costs not yet updated in the field
        self._repaired = -math.inf

    # State ------------------------------------------------------------------------------------

    @property
    def pose(self) -> PlanarPose:
        """The robot's pose in the map."""
        return self.localizer.pose

    @property
    def navigating(self) -> bool:
        """Whether a goal is active."""
        return self._goal is not None

    @property
    def path(self) -> Floats:
        """Points of the path to the goal, (N, 2), m; N = 0 if there is none."""
        if self._goal is None or self._field is None or not self._is_planned:
            return np.zeros((0, 2))
        return self._path(self._field, self._cell(self.pose))

    @property
    def distance_remaining(self) -> float:
        """Length of the path to the goal, m; 0 without a goal."""
        return float(np.hypot(*np.diff(self.path, axis=0).T).sum())

    def costs(self) -> OccupancyGrid:
        """Return the costs of the map, with the values of Nav2's costmaps."""
        return self._costmap.costs()

    # Goals ------------------------------------------------------------------------------------

    def go_to(self, x: float, y: float, yaw: float | None = None) -> None:
        """Drive to a point in the map, m, and a heading there, rad; None: any.

        Raises:
            ValueError: a number is not finite.
        """
        if not all(map(math.isfinite, (x, y, yaw or 0.0))):
            raise ValueError(f"the numbers of a goal must be finite, not {x}, {y}, {yaw}")
        self._begin(_Goal(x, y, yaw))

    def follow(self, path: Floats, yaw: float | None = None) -> None:
        """Drive along a path, around obstacles on it.

        Where a path crosses itself, the robot takes the shorter one.

        Args:
            path: points in the map, (N, 2), m.
            yaw: heading at its end, rad; None: any.

        Raises:
            NavigationError: the path is empty or not finite.
        """
        points = np.asarray(path, float).reshape(-1, 2)
        if not len(points) or not np.isfinite(points).all():
            raise NavigationError(Failure.INVALID_PATH)
        x, y = points[-1].tolist()
        self._begin(_Goal(x, y, yaw, points))

    def drive_straight(self, distance: float, speed: float, time_allowance: float = 0.0) -> None:
        """Drive straight ahead, or backward, and fail if something is in the way.

        Args:
            distance: m; negative: backward.
            speed: m/s, above 0.
            time_allowance: maximum time, s; 0 or less: the parameter time_allowance.

        Raises:
            ValueError: a number is not finite, or the speed not above 0.
        """
        if not math.isfinite(distance) or not 0.0 < speed < math.inf:
            text = "the length of a motion must be finite and its speed above 0"
            raise ValueError(f"{text}, not {distance} and {speed}")
        self._begin(_Motion(distance, speed, False), time_allowance)

    def spin(self, angle: float, time_allowance: float = 0.0) -> None:
        """Turn on the spot, and fail if something is in the way.

        Args:
            angle: rad, to the left; negative: to the right. It may be several turns.
            time_allowance: maximum time, s; 0 or less: the parameter time_allowance.

        Raises:
            ValueError: the angle is not finite, or the robot cannot turn on the spot.
        """
        if not math.isfinite(angle):
            raise ValueError(f"an angle must be finite, not {angle}")
        if self.vehicle.minimum_radius:
            raise ValueError("the robot cannot turn on the spot")
        self._begin(_Motion(angle, self.vehicle.turning, True), time_allowance)

    def _begin(self, goal: _Goal | _Motion, time_allowance: float = 0.0) -> None:
        self._goal = goal
        self._allowance = max(time_allowance, 0.0) or self.parameters.time_allowance or math.inf
        self.status, self.reason, self.failure = "driving", "", None
        self.recoveries, self.traveled = 0, 0.0
        self._field, self._is_planned, self._finishing = None, False, False
        self._costmap.prefer(None)
        self._local_planner.reset()
        self._moved: tuple[float, PlanarPose] | None = None
        self._blocked: float | None = None
        self._searched: float | None = None  # start of the wait in which it looked for what moved
        self._recovery: tuple[Triple, float] | None = None  # a command, and the time of its end
        self._since: float | None = None
        self._last: PlanarPose | None = None
        self._settled = -math.inf  # time from which the map is complete again, s

    def cancel(self, reason: str = "the goal was cancelled") -> None:
        """End the goal, if there is one; the robot stops."""
        if self._goal is not None:
            self._end("cancelled", reason)

    def _end(self, status: str, reason: str = "", failure: Failure | None = None) -> Triple:
        self._goal = None
        self.status, self.reason, self.failure = status, reason, failure
        return _STOP

    def place(self, pose: PlanarPose, covariance: Floats | None = None) -> None:
        """Set the robot's pose in the map, m and rad, for example after a pose estimate."""
        self.localizer.place(pose, covariance)
        self._field = None

    # Sensing ----------------------------------------------------------------------------------

    def update(
        self,
        time: float,
        odometry: PlanarPose,
        speed: Triple,
        *,
        scan: LevelScan | None = None,
        turn: float | None = None,
    ) -> Triple:
        """Process measurements, and return the next command.

        Args:
            time: time of the odometry, s.
            odometry: the robot's pose in the odometry frame.
            speed: its velocity forward, to the left, m/s, and turning to the left, rad/s.
            scan: a new scan; None: there is none.
            turn: turn to the left measured by an IMU since the last call, rad; None: there is no
                IMU.

        Returns:
            The velocity forward, to the left, m/s, and turning to the left, rad/s; zeros without a
            goal.
        """
        jumped = self._notice_jump(time, odometry)
        self._repeats = self._repeats + 1 if time == self.time else 0
        self.time, self.speed, self._odometry = time, speed, odometry
        self.localizer.predict(time, odometry, turn)
        self._latency.measure(speed)
        if scan is not None:
            self._sense(scan, time if scan.time is None else scan.time)
        return self._latency.remember(_STOP if jumped else self._command(time, speed))

    def _command(self, time: float, speed: Triple) -> Triple:
        """Return the next command."""
        if self._goal is None:
            return _STOP
        # Without odometry, time stands still.
        now = time + self._repeats / self.parameters.controller_frequency
        if self._scanned is None or now - self._scanned > _OLDEST_SCAN:
            if self.status != "blocked":
                self.status, self.reason = "blocked", "no scan of the last 0.3 s: waiting"
            return _STOP
        self._since = time if self._since is None else self._since
        try:
            if time - self._since > self._allowance:
                raise NavigationError(Failure.TIMEOUT)
            pose, speed = self._latency.ahead(self.pose, speed)
            if isinstance(self._goal, _Motion):
                return self._move(self._goal, pose, speed)
            return self._drive(self._goal, pose, speed)
        except NavigationError as error:
            return self._end("failed", str(error), error.failure)

    def _notice_jump(self, time: float, odometry: PlanarPose) -> bool:
        """Return whether the odometry exceeds the possible motion of the robot since the last one.

        After a jump, the pose stays, and the robot waits for a scan. If time has gone back or the
        odometry is at its origin, the robot was reset to its start, and the goal ends.
        """
        if self._odometry is None:
            self._origin = self.pose.compose(odometry.inverse())
            return False
        elapsed, vehicle = time - self.time, self.vehicle
        moved = self._odometry.inverse().compose(odometry)
        away, turned = math.hypot(moved.x, moved.y), abs(math.remainder(moved.yaw, math.tau))
        far = away > _JUMP + 3.0 * vehicle.forward * elapsed
        if elapsed >= 0.0 and not far and turned <= _JUMP + 3.0 * vehicle.turning * elapsed:
            return False
        text = f"the odometry has jumped by {away:.2f} m and {turned:.2f} rad"
        self.localizer.rebase()
        self._scanned = None
        if elapsed < 0.0 or math.hypot(odometry.x, odometry.y) < _RESET:
            self.place(self._origin.compose(odometry))
            self.cancel("the robot was reset")
        elif self._goal is not None:
            self.status, self.reason = "blocked", f"{text}: waiting for a scan"
        return True

    def _sense(self, scan: LevelScan, time: float) -> None:
        points = scan.points
        points = points[~self._is_own(points)]
        if len(self._walls.points):
            self.localizer.correct(time, points, self._walls)
        pose = self.localizer.at(time)
        self._entered = scan, points, pose
        try:
            window = self.map.enter(*self._entered)
        except ValueError as error:
            self._scanned = None
            self.cancel(str(error))
            return
        self._scanned, self._scans = time, self._scans + 1
        if not self._given and (self._scans % _WALLS_EVERY == 1 or self._scans < _WALLS_EVERY):
            self._walls = Walls(self.map.walls(pose, _WALLS_REACH))
        self._update_costs(window)

    def _is_own(self, points: Floats, further: float = 0.0) -> Mask:
        """Return which points (N, 2), in the robot's frame, scans regard as the robot itself.

        Args:
            points: the points, m.
            further: distance from such points, m.
        """
        away = np.hypot(*(points[:, None] - self._circles[0]).transpose(2, 0, 1))
        return np.asarray((away <= self._circles[1] + _OWN + further).any(axis=1))

    def _update_costs(self, window: Window) -> None:
        """Update the costs of a changed part of the map, or all if the map has grown."""
        grown = self._costmap.version != self.map.version
        changed = self._costmap.update(window)
        if grown:
            self._field = self._changed = None
        elif changed is not None:
            self._changed = changed.union(self._changed)

    # Planning ---------------------------------------------------------------------------------

    def _cell(self, pose: PlanarPose) -> tuple[int, int]:
        row, column = self.map.cells(np.array([pose[:2]]))[0].tolist()
        rows, columns = self.map.shape
        return min(max(row, 0), rows - 1), min(max(column, 0), columns - 1)

    def _path(self, field: CostToGo, cell: tuple[int, int], limit: int = 100_000) -> Floats:
        """Return the points of the path, at most ``limit`` cells."""
        cells = field.path(field.nearest(cell), limit)
        return self.map.middle(cells[:, 0], cells[:, 1])

    def plan(self, goal: PlanarPose, start: PlanarPose | None = None) -> Floats:
        """Return the path that the robot would drive, from the current map.

        Args:
            goal: target pose in the map.
            start: start pose; None: the robot's.

        Returns:
            (N, 2), points in the map, m, from the start to the goal.

        Raises:
            NavigationError: there is no path; ``failure`` is the reason.
        """
        begin = start or self.pose
        if not all(map(math.isfinite, (*goal, *begin))):
            raise NavigationError(Failure.NO_VALID_PATH)
        field, cell = self._new_field(begin, _Goal(*goal)), self._cell(begin)
        near = Window.around(cell, field.aside, self.map.shape)
        if not np.isfinite(self._costmap.prices[near.cells]).any():
            raise NavigationError(Failure.START_OCCUPIED)
        field.spread(cell, _BEYOND)
        points = self._path(field, cell)
        if not len(points):
            raise NavigationError(Failure.NO_VALID_PATH)
        return points

    def _new_field(self, start: PlanarPose, goal: _Goal) -> CostToGo:
        """Return a new field for a goal.

        Raises:
            NavigationError: the goal is outside of the map, or not free.
        """
        [cell] = self.map.cells(np.array([goal[:2]]))
        if self._given and not self.map.inside(cell[None])[0]:
            raise NavigationError(Failure.GOAL_OUTSIDE_MAP)
        corners = np.array([start[:2], goal[:2]])
        try:
            self.map.cover(corners.min(axis=0) - _AROUND, corners.max(axis=0) + _AROUND)
        except ValueError:
            raise NavigationError(Failure.GOAL_OUTSIDE_MAP) from None
        if self._costmap.version != self.map.version:
            self._update_costs(self.map.whole)
        # The nearest free cell within the tolerance.
        near = self.map.around(PlanarPose(*goal[:2]), self.parameters.xy_goal_tolerance)
        cells = np.argwhere(np.isfinite(self._costmap.prices[near.cells])) + near[:2]
        if not len(cells):
            raise NavigationError(Failure.GOAL_OCCUPIED)
        middles = self.map.middle(cells[:, 0], cells[:, 1])
        best = np.hypot(*(middles - goal[:2]).T).argmin()
        if goal.path is not None:
            self._costmap.prefer(goal.path)
        return CostToGo(self._costmap.prices, self.map.resolution, cells[[best]])

    def _reach(self, goal: _Goal, pose: PlanarPose) -> bool:
        """Extend the field to the robot; return whether it has reached it.

        Raises:
            NavigationError: there is no path.
        """
        if self._field is None:
            self._field = self._new_field(pose, goal)
            self._changed, self._repaired = None, self.time
        field, cell = self._field, self._cell(pose)
        if self._changed is not None and self.time - self._repaired >= _REPAIR_EVERY:
            field.change(self._costmap.prices, self._changed)
            self._changed, self._repaired = None, self.time
        if not field.spread(cell, _BEYOND, math.inf if self._is_planned else _SLICE):
            self.reason = "planning"
            return False
        if math.isfinite(field.value(cell)):
            self._is_planned = True
            return True
        waited = self._wait("there is no path: waiting")
        if waited > _HOPELESS:
            raise NavigationError(Failure.NO_VALID_PATH)
        if waited > _FORGETS and self._searched != self._blocked:
            self._searched = self._blocked
            self._forget_moved()
        return False

    def _forget_moved(self) -> None:
        """Forget what may have moved on where the lidar does not see it, as a recovery."""
        if self.recoveries < _RECOVERIES and (moved := self.map.moved()).any():
            self.recoveries += 1
            self._blocked = None
            self._forget(self.map.whole, moved)

    def _wait(self, text: str) -> float:
        """Let the robot wait; return for how long it has waited, s."""
        self._blocked = self.time if self._blocked is None else self._blocked
        self.status, self.reason = "blocked", text
        return self.time - self._blocked

    def _situation(self, pose: PlanarPose, speed: Triple, goal: tuple[float, float]) -> Situation:
        field, cell = self._field, self._cell(pose)
        values, maximum, path = np.zeros((2, 2)), math.inf, np.zeros((0, 2))
        if field is not None:
            values, maximum = field.values, field.value(cell) + _BEYOND
            path = self._path(field, cell, _SOON)
        costs = self._costmap.fine, values, maximum, self.map.origin, self.map.resolution
        return Situation(pose, speed, goal, *costs, path)

    # Driving ----------------------------------------------------------------------------------

    def _move(self, motion: _Motion, pose: PlanarPose, speed: Triple) -> Triple:
        """Return the command for a motion, and end it at its target."""
        last, self._last = self._last or pose, pose
        sign, vehicle = math.copysign(1.0, motion.length), self.vehicle
        moved = last.inverse().compose(pose)
        self.traveled += sign * (math.remainder(moved.yaw, math.tau) if motion.turns else moved.x)
        left = abs(motion.length) - self.traveled
        if left < _EXACT:
            moving = abs(speed[2] if motion.turns else speed[0]) > 0.05
            return _STOP if moving else self._end("arrived")
        if motion.turns:
            command = 0.0, 0.0, sign * self._turning(left)
        else:
            top = min(motion.speed, vehicle.forward if sign > 0.0 else vehicle.backward)
            command = sign * min(top, self._braking(left), 2.0 * left + 0.01), 0.0, 0.0
        if not self._local_planner.is_safe(self._situation(pose, speed, pose[:2]), command):
            raise NavigationError(Failure.COLLISION_AHEAD)
        return command

    def _drive(self, goal: _Goal, pose: PlanarPose, speed: Triple) -> Triple:
        """Return the command for driving to a pose, and end the goal there."""
        if not self._reach(goal, pose) or self.time < self._settled:
            return _STOP
        now = self._situation(pose, speed, goal[:2])
        away = math.hypot(goal.x - pose.x, goal.y - pose.y)
        if not goal.is_staged and away < _STAGED:
            self._goal = goal = self._staged(goal, now)
            if goal.end:
                self._field = None
                return _STOP
        if self._recovery is not None:
            command, until = self._recovery
            if self.time < until and self._local_planner.is_safe(now, command):
                return command
            self._recovery = None
            self._local_planner.reset()
        if self._finishing or away < _NEAR_GOAL:
            last_stretch = self._finish(goal, pose, speed)
            if self._goal is None:
                return _STOP
            if last_stretch and self._local_planner.is_safe(
                now, last_stretch, narrow=goal.is_straight
            ):
                self._progress(pose)
                self.status, self.reason = "driving", ""
                return last_stretch
        command, free = self._local_planner.command(now)
        stuck = not self._progress(pose)
        if free:
            self._blocked = None
            self.status, self.reason = "driving", ""
        else:
            stuck |= self._wait("something is in the way: waiting") > _PATIENCE
        return self._recover(pose) if stuck else command

    def _finish(self, goal: _Goal, pose: PlanarPose, speed: Triple) -> Triple | None:
        """Return the command for the last stretch, straight to the goal, and end it there."""
        vehicle, tolerance = self.vehicle, self.parameters.xy_goal_tolerance
        away, direction = self._last_stretch(goal, pose)
        if vehicle.minimum_radius:
            if away < max(tolerance, 2.0 * self.map.resolution):
                self._end("arrived")
            return None
        error = 0.0 if goal.yaw is None else math.remainder(goal.yaw - pose.yaw, math.tau)
        near = (0.2 if goal.end or goal.is_straight else 0.4) * tolerance
        self._finishing = away < (1.6 * near if self._finishing else near)
        if self._finishing:
            if abs(error) > 0.4 * self.parameters.yaw_goal_tolerance:
                return 0.0, 0.0, self._turning(error)
            if goal.end:
                x, y = goal.end
                self._goal = goal._replace(x=x, y=y, end=None, is_straight=True)
                self._field, self._finishing = None, False
                return _STOP
            return self._end("arrived") if max(map(abs, speed)) < 0.05 else _STOP
        top = min(self._braking(away), vehicle.forward, 2.0 * away + 0.02)
        bearing = math.remainder(direction - pose.yaw, math.tau)
        if vehicle.sideways:
            top = min(top, vehicle.sideways)
            return top * math.cos(bearing), top * math.sin(bearing), self._turning(error)
        sign = 1.0
        if abs(bearing) > math.pi / 2.0 and vehicle.backward > 0.0:
            sign, bearing = -1.0, math.remainder(bearing + math.pi, math.tau)
            top = min(top, vehicle.backward)
        if abs(bearing) > 0.3 and away * abs(math.sin(bearing)) > 0.01:
            top = 0.0
        return sign * top * math.cos(bearing), 0.0, self._turning(bearing)

    def _last_stretch(self, goal: _Goal, pose: PlanarPose) -> tuple[float, float]:
        """Return the distance to the goal, m, and the direction in the map to drive there, rad.

        A robot that has turned before keeps its heading, unless it has left the line.
        """
        x, y = goal.x - pose.x, goal.y - pose.y
        if goal.is_straight and goal.yaw is not None:
            cos, sin = math.cos(goal.yaw), math.sin(goal.yaw)
            along, across = cos * x + sin * y, cos * y - sin * x
            if abs(across) < 0.6 * self.parameters.xy_goal_tolerance:
                turn = clamp(math.copysign(2.0, along) * across, -_SLIGHT_TURN, _SLIGHT_TURN)
                return abs(along), goal.yaw + turn + (math.pi if along < 0.0 else 0.0)
        return math.hypot(x, y), math.atan2(y, x)

    def _staged(self, goal: _Goal, now: Situation) -> _Goal:
        """Return a goal that knows where to turn to its heading.

        If there is no room to turn at the goal, the robot turns as near as possible, where it only
        has to drive straight on or back to the goal.
        """
        goal = goal._replace(is_staged=True)
        if goal.yaw is None or self.vehicle.minimum_radius:
            return goal
        near = self.map.around(PlanarPose(*goal[:2]), _NEAR_GOAL).quarters
        row, column = np.nonzero(self._costmap.fine[near.cells] > self.vehicle.radius + _MARGIN)
        half = 0.5 * self.map.resolution
        x = self.map.origin[0] + (near.left + column + 0.5) * half - goal.x
        y = self.map.origin[1] + (near.top + row + 0.5) * half - goal.y
        cos, sin = math.cos(goal.yaw), math.sin(goal.yaw)
        away, along, across = np.hypot(x, y), cos * x + sin * y, cos * y - sin * x
        if not len(away) or away.min() < half:
            return goal
        cost = away + 4.0 * np.abs(across)
        best = np.argsort(cost)
        if not self.vehicle.backward:
            best = best[along[best] <= 0.0]
        best = best[:_STAGES]
        shares = np.linspace(0.0, 1.0, 20)[:, None]
        xs = (goal.x + shares * x[best]).astype(np.float32)
        ys = (goal.y + shares * y[best]).astype(np.float32)
        yaws = np.full(xs.shape, goal.yaw, np.float32)
        clearances = self._local_planner.clearances(now, xs, ys, yaws)
        free = np.flatnonzero(clearances.min(axis=0) > _MARGIN)
        if not len(free):
            return goal
        first = best[free[0]]
        return goal._replace(x=goal.x + float(x[first]), y=goal.y + float(y[first]), end=goal[:2])

    def _braking(self, away: float) -> float:
        """Return the speed, m/s, from which the robot easily stops within ``away``, m."""
        return _EASY * math.sqrt(2.0 * self.vehicle.acceleration * max(0.0, away))

    def _turning(self, error: float) -> float:
        """Return the angular velocity, rad/s, for a turn by ``error``, rad."""
        vehicle = self.vehicle
        speed = _EASY * math.sqrt(2.0 * vehicle.turning_acceleration * abs(error))
        return math.copysign(min(speed, vehicle.turning, 3.0 * abs(error)), error)

    # Recovery ---------------------------------------------------------------------------------

    def _progress(self, pose: PlanarPose) -> bool:
        """Return whether the robot has moved recently, and remember its pose."""
        self._visit(pose, 1.0 / self.parameters.controller_frequency)
        since, place = self._moved or (-math.inf, PlanarPose(math.inf))
        turned = abs(math.remainder(pose.yaw - place.yaw, math.tau))
        if math.hypot(pose.x - place.x, pose.y - place.y) > _MOVED or turned > 3.0 * _MOVED:
            since, self._moved = self.time, (self.time, pose)
        return self.time - since <= _STUCK

    def _visit(self, pose: PlanarPose, seconds: float) -> None:
        """Increase the cost of paths near a pose."""
        part = self.map.around(pose, self._radius)
        self._costmap.visit(part, seconds)
        self._changed = part.union(self._changed)

    def _recover(self, pose: PlanarPose) -> Triple:
        """Start the next recovery: clear obstacles nearby, back up, turn."""
        self.recoveries += 1
        self._moved, self._blocked = None, None
        # The robot may not fit through the gap ahead.
        for x, y in self.path[:: math.ceil(self._radius / self.map.resolution)][:3].tolist():
            self._visit(PlanarPose(x, y), _BARRED)
        if self.recoveries > _RECOVERIES:
            raise NavigationError(Failure.FAILED_TO_MAKE_PROGRESS)
        if self.recoveries % 3 == 1 and not self._given:
            self.forget_near(_CLEARED)
        vehicle = self.vehicle
        if self.recoveries % 2 == 1 and vehicle.backward > 0.0:
            self._recovery = (-0.5 * vehicle.backward, 0.0, 0.0), self.time + 1.5
        else:
            sign = 1.0 if self.recoveries % 4 == 2 else -1.0
            self._recovery = (0.0, 0.0, sign * 0.4 * vehicle.turning), self.time + 2.5
        self.status, self.reason = "recovering", "backing up and turning"
        return _STOP
