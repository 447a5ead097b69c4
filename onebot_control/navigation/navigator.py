"""Drives a robot to goals: what happens from a goal to its end.

``Navigator.update`` is called with odometry and scans, and returns commands of velocity. It keeps
the map and the robot's pose in it, plans, follows, waits before what blocks the way, recovers, and
gives up with a reason. It reads no clock and imports no ROS: a simulation, a node beside a real
robot or a bag may drive it.

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
from dataclasses import dataclass, replace
from enum import Enum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt

from onebot_control.navigation.cost_to_go import CostToGo
from onebot_control.navigation.costmap import Costmap
from onebot_control.navigation.follower import Follower, Surroundings
from onebot_control.navigation.footprint import Vehicle
from onebot_control.navigation.grid import GridMap, LevelScan, Window, placed
from onebot_control.navigation.localization import Localizer
from onebot_control.navigation.scan_matching import Walls
from onebot_control.occupancy_grid import OccupancyGrid
from onebot_description.arrays import Floats, Singles
from onebot_description.errors import OneBotError
from onebot_description.geometry.poses import PlanarPose, Triple

_STOP: Triple = (0.0, 0.0, 0.0)
_OLDEST_SCAN = 0.3  # s
_WALLS_EVERY = 4  # scans after which the walls that scans are matched to are gathered anew
_WALLS_REACH = 8.0  # m
_BEYOND = 3.0  # price by which the field is known beyond the robot
_SLICE = 30_000  # cells of a first field in one update
_REPAIR_EVERY = 0.2  # s between repairs of the field
_REPRICE_EVERY = 1.0  # s
_BARRED = 20.0  # s of visits that a place counts where the robot got stuck
_JUMP = 0.2  # m by which odometry may differ from what the robot can drive
_EXACT = 0.01  # m or rad at which a motion has ended
_OFF_PATH = 30.0  # further price 1 m off a followed path
_ASIDE = 4  # cells within which the robot leaves what is too near
_MARGIN = 0.01  # m that a gap is to be wider than the robot on either side
_CAREFUL, _TIGHT = 0.5, 0.06  # m/s, speed in places where the clearance is less, m
_SOON = 30  # cells of the way that the follower gets
_OWN = 0.02  # m around the footprint in which a scan sees the robot itself
_PATIENCE = 2.0  # s to wait before what blocks the way
_HOPELESS = 6.0  # s without any way to the goal until it is given up
_STUCK = 5.0  # s in which the robot has to move
_MOVED = 0.15  # m, or three times as many rad, that count as moving
_RECOVERIES = 6  # maximum number without progress between them
_NEAR_GOAL = 0.4  # m
_EASY = 0.7  # share of the speed from which the robot could just stop


class Failure(Enum):
    """Why a goal was not reached; Nav2's error codes have these names."""

    GOAL_OCCUPIED = "the goal is in an obstacle, or too near to one"
    GOAL_OUTSIDE_MAP = "the goal is outside of the map"
    START_OCCUPIED = "the start is in an obstacle, or too near to one"
    NO_VALID_PATH = "there is no way to the goal"
    FAILED_TO_MAKE_PROGRESS = "the robot is stuck"
    TIMEOUT = "it took longer than allowed"
    COLLISION_AHEAD = "something is in the way"
    INVALID_PATH = "the path is empty or not finite"


class NavigationError(OneBotError):
    """There is no plan; ``failure`` says why."""

    def __init__(self, failure: Failure) -> None:
        """Take the failure."""
        super().__init__(failure.value)
        self.failure = failure


@dataclass(frozen=True)
class NavigationParameters:
    """How goals are reached; the names are Nav2's.

    Attributes:
        xy_goal_tolerance: distance from the goal at which it is reached, m.
        yaw_goal_tolerance: likewise the difference of heading, rad.
        resolution: edge of the map's cells, m.
        controller_frequency: commands per second, Hz.
        time_allowance: time for a goal, s.
        speed_limit: maximum speed, m/s; infinite: the robot's.
    """

    xy_goal_tolerance: float = 0.05
    yaw_goal_tolerance: float = 0.1
    resolution: float = 0.05
    controller_frequency: float = 20.0
    time_allowance: float = math.inf
    speed_limit: float = math.inf


class _Goal(NamedTuple):
    """A pose to drive to, in the map."""

    x: float
    y: float
    yaw: float | None


class _Motion(NamedTuple):
    """A motion along, or a turn on the spot, from where the robot is when it begins."""

    length: float  # m, or rad to the left; negative: backward, or to the right
    speed: float  # m/s or rad/s, at least 0
    turns: bool


class Navigator:
    """Drives one robot.

    Attributes:
        vehicle: the robot's footprint and limits.
        map: the map; the scans' own, or a given one with what scans have changed.
        localizer: the robot's pose in it.
        status: "idle", "driving", "blocked", "recovering", "arrived", "cancelled" or "failed".
        reason: one sentence on the status; "" if there is nothing to say.
        failure: why the last goal failed; None if it has not.
        recoveries: number of recoveries for this goal.
        traveled: by a motion of ``drive_straight`` or ``spin``, m or rad, at least 0.
    """

    def __init__(
        self,
        vehicle: Vehicle,
        start: PlanarPose,
        *,
        parameters: NavigationParameters | None = None,
        known: OccupancyGrid | None = None,
    ) -> None:
        """Begin without a goal.

        Args:
            vehicle: the robot.
            start: its pose in the map.
            parameters: how goals are reached.
            known: a map that is given; None: it begins empty, and scans make it.
        """
        self.parameters = parameters or NavigationParameters()
        self.localizer = Localizer(start)
        self._given = known
        self._take(vehicle)
        self.status, self.reason = "idle", ""
        self.failure: Failure | None = None
        self._goal: _Goal | _Motion | None = None
        self.time, self.traveled = 0.0, 0.0
        self._odometry: tuple[float, PlanarPose] | None = None
        self._begin_map()

    def _begin_map(self) -> None:
        given, parameters = self._given, self.parameters
        self.map = GridMap.of(given) if given else GridMap(parameters.resolution)
        self._costmap = Costmap(self.map, self._radius)
        if self._given:
            self._costmap.update(Window(0, 0, *self.map.shape))
        self._walls = Walls(self.map.walls())
        self._followed: Floats | None = None
        self._corridor: Singles | None = None  # surcharge of each cell off a followed path
        self._scans = 0
        self._scanned: float | None = None
        self._field: CostToGo | None = None
        self._changed: Window | None = None  # part of the prices that the field does not know yet
        self._repaired = self._repriced = -math.inf
        self._visited: Window | None = None  # part where the robot was since prices were computed
        self._is_planned = False
        self.recoveries = 0

    def use_vehicle(self, vehicle: Vehicle) -> None:
        """Take the robot to have another footprint or other limits from now on."""
        self._take(vehicle)
        self._costmap = Costmap(self.map, self._radius)
        if self.map.log_odds.size:
            self._costmap.update(Window(0, 0, *self.map.shape))
        self._field = None

    def _take(self, vehicle: Vehicle) -> None:
        """Derive from the robot what plans and commands need of it."""
        self.vehicle = vehicle
        period = 1.0 / self.parameters.controller_frequency
        self._follower = Follower(vehicle, period)
        # In narrow places it looks less far ahead, in smaller steps.
        careful = replace(vehicle, forward=min(vehicle.forward, _CAREFUL))
        self._careful = Follower(careful, period)
        self._circles = vehicle.circles()
        given = self._given
        resolution = given.resolution if given else self.parameters.resolution
        # The best way may lie between the middles of cells.
        self._radius = vehicle.half_width + _MARGIN - 0.25 * resolution

    # What can be read -------------------------------------------------------------------------

    @property
    def pose(self) -> PlanarPose:
        """The robot's pose in the map."""
        return self.localizer.pose

    @property
    def navigating(self) -> bool:
        """Whether there is a goal that has not ended."""
        return self._goal is not None

    @property
    def path(self) -> Floats:
        """Points of the way to the goal, (N, 2), m; N = 0 if there is none."""
        return self._way(100_000)

    def _way(self, most: int) -> Floats:
        """Return the points of the way in at most so many cells."""
        if self._goal is None or self._field is None or not self._is_planned:
            return np.zeros((0, 2))
        cells = self._field.way(_nearest(self._field, self._cell(self.pose)), most)
        return self.map.middle(cells[:, 0], cells[:, 1])

    @property
    def distance_remaining(self) -> float:
        """Length of the way to the goal, m; 0 without a goal."""
        points = self.path
        return float(np.hypot(*np.diff(points, axis=0).T).sum()) if len(points) else 0.0

    @property
    def footprint(self) -> Floats:
        """The corners of the robot in the map, (N, 2), m."""
        return placed(self.vehicle.footprint, self.pose)

    def costs(self) -> OccupancyGrid:
        """Return the costs of the map, as Nav2's costmaps have them."""
        return self._costmap.costs()

    # Goals ------------------------------------------------------------------------------------

    def go_to(
        self, x: float, y: float, yaw: float | None = None, *, time_allowance: float | None = None
    ) -> None:
        """Drive to a point in the map, m, and a heading there, rad; None: any.

        Args:
            x: x coordinate, m.
            y: y coordinate, m.
            yaw: heading, rad.
            time_allowance: time for it, s; None: the parameter's.

        Raises:
            ValueError: a number is not finite.
        """
        if not all(map(math.isfinite, (x, y, yaw or 0.0))):
            raise ValueError(f"a goal has finite numbers, not {x}, {y}, {yaw}")
        self._begin(_Goal(x, y, yaw), time_allowance)

    def follow(
        self, path: Floats, yaw: float | None = None, *, time_allowance: float | None = None
    ) -> None:
        """Drive along a path, around what stands on it.

        Where a path crosses itself, the shorter way is taken.

        Args:
            path: points in the map, (N, 2), m.
            yaw: heading at its end, rad; None: any.
            time_allowance: time for it, s; None: the parameter's.

        Raises:
            NavigationError: the path is empty or not finite.
        """
        points = np.asarray(path, float).reshape(-1, 2)
        if not len(points) or not np.isfinite(points).all():
            raise NavigationError(Failure.INVALID_PATH)
        x, y = points[-1].tolist()
        self._begin(_Goal(x, y, yaw), time_allowance)
        self._followed = points

    def drive_straight(
        self, distance: float, speed: float, *, time_allowance: float | None = None
    ) -> None:
        """Drive straight ahead, or backward, and fail if something is in the way.

        Args:
            distance: m; negative: backward.
            speed: m/s, above 0.
            time_allowance: time for it, s; None: the parameter's.

        Raises:
            ValueError: a number is not finite, or the speed not above 0.
        """
        self._begin_motion(_Motion(distance, speed, False), time_allowance)

    def spin(self, angle: float, *, time_allowance: float | None = None) -> None:
        """Turn on the spot, and fail if something is in the way.

        Args:
            angle: rad, to the left; negative: to the right. It may be several turns.
            time_allowance: time for it, s; None: the parameter's.

        Raises:
            ValueError: the angle is not finite.
        """
        self._begin_motion(_Motion(angle, self.vehicle.turning, True), time_allowance)

    def _begin_motion(self, motion: _Motion, time_allowance: float | None) -> None:
        if not math.isfinite(motion.length) or not 0.0 < motion.speed < math.inf:
            text = "a motion has a finite length and a speed above 0"
            raise ValueError(f"{text}, not {motion.length} and {motion.speed}")
        self._begin(motion, time_allowance)

    def _begin(self, goal: _Goal | _Motion, time_allowance: float | None) -> None:
        self._goal, self._followed = goal, None
        self._allowance = (
            self.parameters.time_allowance if time_allowance is None else time_allowance
        )
        self.status, self.reason, self.failure = "driving", "", None
        self.recoveries, self.traveled = 0, 0.0
        self._field, self._is_planned = None, False
        self._costmap.forget_visits()
        self._follower.reset()
        self._careful.reset()
        self._moved: tuple[float, PlanarPose] | None = None
        self._blocked: float | None = None
        self._hopeless: float | None = None
        self._recovery: _Recovery | None = None
        self._since: float | None = None
        self._last: PlanarPose | None = None
        self._finishing = False

    def cancel(self, reason: str = "the goal was cancelled") -> None:
        """End the goal, if there is one; the robot stops."""
        if self._goal is not None:
            self._end("cancelled", reason)

    def _end(self, status: str, reason: str, failure: Failure | None = None) -> None:
        self._goal = None
        self.status, self.reason, self.failure = status, reason, failure

    def _fail(self, failure: Failure) -> Triple:
        self._end("failed", failure.value, failure)
        return _STOP

    def place(self, pose: PlanarPose, covariance: Floats | None = None) -> None:
        """Take the robot to be at a pose in the map, m and rad, as after a pose estimate."""
        self.localizer.place(pose, covariance)
        self._field = None

    def clear(self) -> None:
        """Forget what scans have found; a given map stays."""
        self._begin_map()

    # Sensing ----------------------------------------------------------------------------------

    def update(
        self,
        time: float,
        odometry: PlanarPose,
        speed: Triple,
        *,
        scan: LevelScan | None = None,
        scan_time: float | None = None,
        turn: float | None = None,
    ) -> Triple:
        """Take measurements, and return the next command.

        Args:
            time: of the odometry, s; it never goes back.
            odometry: the robot's pose in the odometry's frame.
            speed: its velocity forward, to the left, m/s, and turning to the left, rad/s.
            scan: a scan that was not given before; None: there is none.
            scan_time: when it was measured, s; None: now.
            turn: how far an IMU has turned to the left since the last call, rad; None: there is
                none.

        Returns:
            The velocity forward, to the left, m/s, and of turning to the left, rad/s; zeros without
            a goal.
        """
        if self._jumped(time, odometry):
            self.localizer.rebase()
        self.time, self._odometry = time, (time, odometry)
        self.localizer.predict(time, odometry, turn)
        if scan is not None:
            self._sense(scan, time if scan_time is None else scan_time)
        if self._goal is None:
            return _STOP
        if self._scanned is None or time - self._scanned > _OLDEST_SCAN:
            self.status, self.reason = "blocked", "no scan comes: waiting"
            return _STOP
        self._since = time if self._since is None else self._since
        if time - self._since > self._allowance:
            return self._fail(Failure.TIMEOUT)
        if isinstance(self._goal, _Motion):
            return self._move(self._goal, speed)
        return self._drive(self._goal, speed)

    def _jumped(self, time: float, odometry: PlanarPose) -> bool:
        """Return whether the odometry is farther from the last one than the robot could drive."""
        if self._odometry is None:
            return False
        since, last = self._odometry
        most = _JUMP + 3.0 * self.vehicle.forward * max(0.0, time - since)
        return not math.hypot(odometry.x - last.x, odometry.y - last.y) < most

    def _sense(self, scan: LevelScan, time: float) -> None:
        points = scan.points
        away = np.hypot(*(points[:, None] - self._circles[0]).transpose(2, 0, 1))
        points = points[(away > self._circles[1] + _OWN).all(axis=1)]
        if len(self._walls.points):
            self.localizer.correct(time, points, self._walls)
        pose = self.localizer.at(time)
        self._entered = scan, points, pose
        window = self.map.enter(*self._entered)
        self._scanned, self._scans = time, self._scans + 1
        if not self._given and (self._scans % _WALLS_EVERY == 1 or self._scans < _WALLS_EVERY):
            self._walls = Walls(self.map.walls(pose, _WALLS_REACH))
        resized = self._costmap.version != self.map.version
        changed = self._costmap.update(window)
        if resized:
            self._forget_field()
        elif changed is not None:
            self._changed = changed.union(self._changed)

    # Driving ----------------------------------------------------------------------------------

    def _cell(self, pose: PlanarPose) -> tuple[int, int]:
        row, column = self.map.cells(np.array([pose[:2]]))[0].tolist()
        rows, columns = self.map.shape
        return min(max(row, 0), rows - 1), min(max(column, 0), columns - 1)

    def _forget_field(self) -> None:
        self._field = self._corridor = self._changed = self._visited = None

    def _move(self, motion: _Motion, speed: Triple) -> Triple:
        """Return the command for a motion; end it where it ends."""
        pose = self.pose
        last, self._last = self._last or pose, pose
        sign, vehicle = math.copysign(1.0, motion.length), self.vehicle
        if motion.turns:
            self.traveled += sign * math.remainder(pose.yaw - last.yaw, math.tau)
            left = abs(motion.length) - self.traveled
            rate = math.copysign(min(abs(self._turning(left)), motion.speed), left)
            command = 0.0, 0.0, sign * rate
        else:
            along = last.inverse().compose(pose).x
            self.traveled += sign * along
            left = abs(motion.length) - self.traveled
            top = min(motion.speed, vehicle.forward if sign > 0.0 else vehicle.backward)
            braking = _EASY * math.sqrt(2.0 * vehicle.acceleration * max(0.0, left))
            command = sign * min(top, braking, 2.0 * left + 0.01), 0.0, 0.0
        if left < _EXACT:
            if abs(speed[2] if motion.turns else speed[0]) < 0.05:
                self._end("arrived", "")
            return _STOP
        if not self._follower.is_safe(self._around(pose), command, pose, speed):
            return self._fail(Failure.COLLISION_AHEAD)
        return command

    def _drive(self, goal: _Goal, speed: Triple) -> Triple:
        pose = self.pose
        if not self._reach(goal, pose):
            return _STOP
        around = self._around(pose)
        if self._recovery is not None:
            command = self._recovery.step(self.time)
            if command is not None and self._follower.is_safe(around, command, pose, speed):
                return command
            self._recovery = None
            self._follower.reset()
            self._careful.reset()
        away = math.hypot(goal.x - pose.x, goal.y - pose.y)
        if self._finishing or away < _NEAR_GOAL:
            command = self._finish(goal, pose, speed)
            if self._goal is None:
                return _STOP
            if command is not None and self._follower.is_safe(around, command, pose, speed):
                self._progress(pose)
                self.status, self.reason = "driving", ""
                return command
        clearance = self._follower.clearance(around, pose)
        slow = max(abs(speed[0]), abs(speed[1])) <= _CAREFUL
        follower = self._careful if clearance < _TIGHT and slow else self._follower
        command, free = follower.command(
            around, pose, speed, (goal.x, goal.y), limit=self.parameters.speed_limit
        )
        if free:
            self._blocked = None
            self.status, self.reason = "driving", ""
        else:
            self._blocked = self.time if self._blocked is None else self._blocked
            self.status, self.reason = "blocked", "something is in the way: waiting"
            if self.time - self._blocked > _PATIENCE:
                return self._recover(pose)
        if not self._progress(pose):
            return self._recover(pose)
        return command

    def _reach(self, goal: _Goal, pose: PlanarPose) -> bool:
        """Let the field reach the robot; return whether it does."""
        if self._field is None:
            try:
                self._field = self._new_field(pose, goal)
            except NavigationError as error:
                self._fail(error.failure)
                return False
        field, cell = self._field, self._cell(pose)
        if self._changed is not None and self.time - self._repaired >= _REPAIR_EVERY:
            field.change(self._prices(), self._changed)
            self._changed, self._repaired = None, self.time
        if not self._spread(field, cell, math.inf if self._is_planned else _SLICE):
            self.reason = "planning"
            return False
        if math.isinf(self._value(cell)):
            self._hopeless = self.time if self._hopeless is None else self._hopeless
            self.status, self.reason = "blocked", "there is no way: waiting"
            if self.time - self._hopeless > _HOPELESS:
                self._fail(Failure.NO_VALID_PATH)
            return False
        self._is_planned, self._hopeless = True, None
        return True

    def _spread(self, field: CostToGo, cell: tuple[int, int], budget: float) -> bool:
        """Let a field go on until it is known around a cell; return whether it is.

        Args:
            field: the field.
            cell: row and column.
            budget: how many cells there may be until then.
        """

        def target() -> float:
            return _value(field, cell) + 2.0 * _BEYOND

        if field.level < target():
            for count in field.spread():
                budget -= count
                if field.level >= target():
                    break
                if budget < 0:
                    return False
        return True

    def plan(self, goal: PlanarPose, start: PlanarPose | None = None) -> Floats:
        """Return the way that the robot would drive, by what is known now.

        Args:
            goal: where to, in the map.
            start: from where; None: from where the robot is.

        Returns:
            (N, 2), points in the map, m, from the start to the goal.

        Raises:
            NavigationError: there is no way; ``failure`` says why.
        """
        begin = start or self.pose
        if not all(map(math.isfinite, (*goal, *begin))):
            raise NavigationError(Failure.NO_VALID_PATH)
        version = self.map.version
        field = self._new_field(begin, _Goal(*goal), followed=False)
        if self.map.version != version:
            self._forget_field()
        cell = self._cell(begin)
        prices = self._costmap.prices
        if not np.isfinite(prices[_around_cell(cell, prices.shape)]).any():
            raise NavigationError(Failure.START_OCCUPIED)
        self._spread(field, cell, math.inf)
        cells = field.way(_nearest(field, cell))
        if not len(cells):
            raise NavigationError(Failure.NO_VALID_PATH)
        return self.map.middle(cells[:, 0], cells[:, 1])

    def _value(self, cell: tuple[int, int]) -> float:
        return math.inf if self._field is None else _value(self._field, cell)

    def _new_field(self, start: PlanarPose, goal: _Goal, *, followed: bool = True) -> CostToGo:
        """Return a field from a goal that begins to spread.

        Raises:
            NavigationError: the goal is outside of the map, or not free.
        """
        margin = 2.0 + self.vehicle.outer_radius
        low = min(goal.x, start.x) - margin, min(goal.y, start.y) - margin
        high = max(goal.x, start.x) + margin, max(goal.y, start.y) + margin
        cell = self.map.cells(np.array([(goal.x, goal.y)]))
        if self._given and not self.map.inside(cell)[0]:
            raise NavigationError(Failure.GOAL_OUTSIDE_MAP)
        try:
            self.map.cover(low, high)
        except ValueError:
            raise NavigationError(Failure.GOAL_OUTSIDE_MAP) from None
        if self._costmap.version != self.map.version:
            self._costmap.update(Window(0, 0, *self.map.shape))
        cells = self._free_cells(goal)
        if not len(cells):
            raise NavigationError(Failure.GOAL_OCCUPIED)
        prices = self._costmap.prices
        if followed:
            self._corridor = self._beside_path()
            prices = self._prices()
            self._changed, self._repaired = None, self.time
        return CostToGo(prices, self.map.resolution, cells)

    def _beside_path(self) -> Singles | None:
        """Return by how much prices are higher off the followed path; None if there is none."""
        if self._followed is None:
            return None
        points, away = self._followed, np.ones(self.map.shape, np.bool_)
        for start, end in zip(points[:-1], points[1:], strict=True):
            count = math.ceil(float(np.hypot(*(end - start))) / (0.5 * self.map.resolution)) + 1
            between = start + np.linspace(0.0, 1.0, count)[:, None] * (end - start)
            cells = self.map.cells(between)
            away[tuple(cells[self.map.inside(cells)].T)] = False
        distances = distance_transform_edt(away) * self.map.resolution
        return np.asarray(1.0 + _OFF_PATH * np.minimum(distances, 1.0), np.float32)

    def _prices(self) -> Singles:
        prices = self._costmap.prices
        return prices if self._corridor is None else prices * self._corridor

    def _free_cells(self, goal: _Goal) -> NDArray[np.intp]:
        """Return the goal's cell, or the nearest free one within the tolerance, (0 or 1, 2)."""
        resolution = self.map.resolution
        half = math.ceil(self.parameters.xy_goal_tolerance / resolution)
        middle = self.map.cells(np.array([(goal.x, goal.y)]))[0]
        away = np.arange(-half, half + 1)
        offsets = np.stack(np.meshgrid(away, away, indexing="ij"), axis=-1).reshape(-1, 2)
        offsets = offsets[np.argsort((offsets**2).sum(axis=1), kind="stable")]
        cells = middle + offsets
        cells = cells[self.map.inside(cells)]
        free = np.isfinite(self._costmap.prices[tuple(cells.T)])
        return np.asarray(cells[free][:1])

    def _around(self, pose: PlanarPose) -> Surroundings:
        field = np.zeros((2, 2)) if self._field is None else self._field.values
        return Surroundings(
            self._costmap.fine,
            field,
            self._value(self._cell(pose)) + 2.0 * _BEYOND,
            self.map.origin,
            self.map.resolution,
            self._way(_SOON),
        )

    def _finish(self, goal: _Goal, pose: PlanarPose, speed: Triple) -> Triple | None:
        """Return the command for the last stretch, straight to the goal; end it there."""
        vehicle, parameters = self.vehicle, self.parameters
        x, y = goal.x - pose.x, goal.y - pose.y
        away = math.hypot(x, y)
        if vehicle.least_radius:
            if away < max(parameters.xy_goal_tolerance, 2.0 * self.map.resolution):
                self._end("arrived", "")
            return None
        near = 0.4 * parameters.xy_goal_tolerance
        if away < near or (self._finishing and away < 1.6 * near):
            self._finishing = True
            error = 0.0 if goal.yaw is None else math.remainder(goal.yaw - pose.yaw, math.tau)
            if abs(error) < 0.4 * parameters.yaw_goal_tolerance:
                if max(abs(speed[0]), abs(speed[1]), abs(speed[2])) < 0.05:
                    self._end("arrived", "")
                return _STOP
            return 0.0, 0.0, self._turning(error)
        self._finishing = False
        top = _EASY * math.sqrt(2.0 * vehicle.acceleration * away)
        top = min(top, vehicle.forward, parameters.speed_limit, 2.0 * away + 0.02)
        bearing = math.remainder(math.atan2(y, x) - pose.yaw, math.tau)
        if vehicle.sideways:
            error = 0.0 if goal.yaw is None else math.remainder(goal.yaw - pose.yaw, math.tau)
            top = min(top, vehicle.sideways)
            return top * math.cos(bearing), top * math.sin(bearing), self._turning(error)
        sign = 1.0
        if abs(bearing) > math.pi / 2.0 and vehicle.backward > 0.0:
            sign, bearing = -1.0, math.remainder(bearing + math.pi, math.tau)
            top = min(top, vehicle.backward)
        if abs(bearing) > 0.3 and away * abs(math.sin(bearing)) > 0.01:
            top = 0.0
        return sign * top * math.cos(bearing), 0.0, self._turning(bearing)

    def _turning(self, error: float) -> float:
        """Return the velocity, rad/s, to turn by an angle, rad."""
        vehicle = self.vehicle
        speed = _EASY * math.sqrt(2.0 * vehicle.turning_acceleration * abs(error))
        return math.copysign(min(speed, vehicle.turning, 3.0 * abs(error)), error)

    # When it does not go on -------------------------------------------------------------------

    def _progress(self, pose: PlanarPose) -> bool:
        """Return whether the robot has moved in the last seconds; remember where it was."""
        period = 1.0 / self.parameters.controller_frequency
        self._visit(self._costmap.visit(self._cell(pose), self._radius, period))
        if self._moved is None:
            self._moved = self.time, pose
        since, place = self._moved
        turned = abs(math.remainder(pose.yaw - place.yaw, math.tau))
        if math.hypot(pose.x - place.x, pose.y - place.y) > _MOVED or turned > 3.0 * _MOVED:
            self._moved = self.time, pose
        elif self.time - since > _STUCK:
            return False
        return True

    def _visit(self, part: Window) -> None:
        """Take over that ways through a part are dearer; the field is updated later."""
        self._visited = part.union(self._visited)
        if self.time - self._repriced > _REPRICE_EVERY:
            self._costmap.price(self._visited)
            self._changed = self._visited.union(self._changed)
            self._visited, self._repriced = None, self.time

    def _recover(self, pose: PlanarPose) -> Triple:
        """Begin the next recovery: forget obstacles nearby, back up, turn."""
        self.recoveries += 1
        self._moved, self._blocked = None, None
        # The gap ahead may be one that it cannot drive through.
        for x, y in self.path[:: math.ceil(self._radius / self.map.resolution)][:3]:
            cell = self._cell(PlanarPose(float(x), float(y)))
            self._visit(self._costmap.visit(cell, self._radius, _BARRED))
        if self.recoveries > _RECOVERIES:
            return self._fail(Failure.FAILED_TO_MAKE_PROGRESS)
        if self.recoveries % 3 == 1 and not self._given:
            window = self.map.clear_around(pose, 1.5)
            self.map.enter(*self._entered)
            changed = self._costmap.update(window)
            self._changed = changed.union(self._changed) if changed else self._changed
        self._recovery = _Recovery(self.vehicle, self.recoveries, self.time)
        self.status, self.reason = "recovering", "it backs up and turns"
        return _STOP


class _Recovery:
    """Backs up, or turns."""

    def __init__(self, vehicle: Vehicle, number: int, time: float) -> None:
        backs = number % 2 == 1 and vehicle.backward > 0.0
        way = 0.5 * vehicle.backward if backs else 0.0
        turn = 0.0 if backs else 0.4 * vehicle.turning * (1.0 if number % 4 == 2 else -1.0)
        self._command = -way, 0.0, turn
        self._until = time + (1.5 if backs else 2.5)

    def step(self, time: float) -> Triple | None:
        """Return the command; None at the end."""
        return self._command if time < self._until else None


def _around_cell(cell: tuple[int, int], shape: tuple[int, ...]) -> tuple[slice, slice]:
    row, column = cell
    return Window(row, column, row + 1, column + 1).grown(_ASIDE, shape).cells


def _nearest(field: CostToGo, cell: tuple[int, int]) -> tuple[int, int]:
    """Return the cell; the best one near it if the robot is too near to an obstacle there."""
    values = field.values
    if math.isfinite(values[cell]):
        return cell
    part = _around_cell(cell, values.shape)
    row, column = np.unravel_index(values[part].argmin(), values[part].shape)
    return part[0].start + int(row), part[1].start + int(column)


def _value(field: CostToGo, cell: tuple[int, int]) -> float:
    """Return the cost to go at a cell, or near it if the robot is too near to an obstacle."""
    return float(field.values[_nearest(field, cell)])
