"""Footprints, prices, costs to go, and the commands that are chosen by them."""

import math

import numpy as np
import pytest
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import cKDTree

from onebot_control.navigation.cost_to_go import CostToGo
from onebot_control.navigation.costmap import Costmap
from onebot_control.navigation.footprint import Vehicle, footprint_of
from onebot_control.navigation.grid import GridMap, LevelScan, Window, placed
from onebot_control.navigation.local_planner import LocalPlanner, Situation
from onebot_control.navigation.navigator import Failure, NavigationError, Navigator
from onebot_control.navigation.parameters import NavigationParameters
from onebot_control.occupancy_grid import OccupancyGrid
from onebot_description.description import load_description
from onebot_description.geometry.poses import PlanarPose
from tests.onebot_control.test_navigation_map import ORIGIN, room_scan

SQUARE = np.array([(-0.2, -0.15), (0.1, -0.15), (0.1, 0.15), (-0.2, 0.15)])


def vehicle(**changes) -> Vehicle:
    limits = {"forward": 0.5, "backward": 0.2, "sideways": 0.0, "turning": 2.0}
    rates = {"acceleration": 1.0, "turning_acceleration": 3.0}
    return Vehicle(SQUARE, **{**limits, **rates, **changes})


# Footprints ---------------------------------------------------------------------------------------


def test_the_footprint_of_onebot():
    """Its wheels are 0.3 m apart, and its tail is longer than its front."""
    footprint = footprint_of(
        load_description("package://onebot_description/urdf/onebot.urdf.xacro")
    )
    low, high = footprint.min(axis=0), footprint.max(axis=0)
    assert low == pytest.approx([-0.33, -0.152], abs=0.002)
    assert high == pytest.approx([0.095, 0.152], abs=0.002)
    assert Vehicle(footprint, 1, 1, 0, 1, 1, 1).half_width == pytest.approx(0.152, abs=0.002)


@pytest.mark.parametrize("size", [(0.3, 0.3), (0.5, 0.43), (0.8, 0.3), (0.2, 0.6)])
def test_circles_cover_the_footprint_and_hardly_more(size):
    half = np.array(size) / 2.0
    corners = half * [(-1, -1), (1, -1), (1, 1), (-1, 1)] + (0.07, 0.0)
    centers, radii = Vehicle(corners, 1, 1, 0, 1, 1, 1).circles()
    share = np.linspace(0.0, 1.0, 50)[:, None, None]
    rim = (corners + share * (np.roll(corners, -1, axis=0) - corners)).reshape(-1, 2)
    away = np.hypot(*(rim[:, None] - centers).transpose(2, 0, 1)) - radii
    assert away.min(axis=1).max() < 0.002
    beyond = np.abs(centers - (0.07, 0.0)) + radii[:, None] - half
    assert beyond.max() < 0.011


# Costs --------------------------------------------------------------------------------------------


def by_dijkstra(prices, resolution, goal):
    """The same costs to go by scipy's algorithm on a graph of cells."""
    prices = prices.astype(float)
    rows, columns = prices.shape
    index = np.arange(prices.size).reshape(prices.shape)
    starts, ends, costs = [], [], []
    for a, b in ((0, 1), (1, 0), (1, 1), (1, -1)):
        here = index[: rows - a, max(0, -b) : columns - max(0, b)].ravel()
        there = index[a:, max(0, b) : columns + min(0, b)].ravel()
        cost = (prices.ravel()[here] + prices.ravel()[there]) * resolution / 2.0 * math.hypot(a, b)
        free = np.isfinite(cost)
        starts.append(here[free]), ends.append(there[free]), costs.append(cost[free])
    entries = np.concatenate(costs), (np.concatenate(starts), np.concatenate(ends))
    graph = coo_array(entries, shape=(prices.size, prices.size)).tocsr()
    return dijkstra(graph, directed=False, indices=index[goal]).reshape(prices.shape)


def random_prices(seed, shape=(60, 80)):
    generator = np.random.default_rng(seed)
    prices = generator.choice([1.0, 2.0, 9.0], shape)
    prices[generator.random(shape) < 0.25] = np.inf
    prices[30, 40] = prices[5, 5] = 1.0
    return prices.astype(np.float32)


def whole(prices, goal=(30, 40)) -> CostToGo:
    field = CostToGo(prices, 0.05, np.array([goal]))
    field.spread()
    return field


@pytest.mark.parametrize("seed", range(4))
def test_costs_to_go_are_dijkstras(seed):
    prices = random_prices(seed)
    np.testing.assert_allclose(whole(prices).values, by_dijkstra(prices, 0.05, (30, 40)), 1e-9)


@pytest.mark.parametrize("seed", range(4))
def test_a_repaired_field_is_that_of_the_new_prices(seed):
    """Whether prices rise or fall, near the goal or far from it, known already or not."""
    prices, generator = random_prices(seed), np.random.default_rng(seed)
    field = CostToGo(prices, 0.05, np.array([(30, 40)]))
    field.spread((30, 40), 2.0)
    for _ in range(5):
        top, left = generator.integers(0, [50, 70]).tolist()
        part = Window(top, left, top + 10, left + 10)
        prices[part.cells] = generator.choice([1.0, 4.0, np.inf], (10, 10))
        field.change(prices, part)
        field.spread((30, 40), generator.uniform(1.0, 5.0))
    field.spread()
    np.testing.assert_allclose(field.values, by_dijkstra(prices, 0.05, (30, 40)), 1e-6)


def test_a_wave_stops_where_it_is_told_and_goes_on():
    prices = np.ones((100, 100), np.float32)
    field = CostToGo(prices, 0.05, np.array([(0, 0)]))
    assert field.spread((0, 0), 1.0) and np.isinf(field.values[99, 99])
    assert np.isfinite(field.values).sum() < 2000
    assert not field.spread((99, 99), budget=100) and np.isinf(field.values[99, 99])
    assert field.values[0, 20] == pytest.approx(1.0)
    field.spread()
    assert field.values[99, 99] == pytest.approx(99 * 0.05 * math.sqrt(2.0))
    assert field.path((3, 3)).tolist() == [[3, 3], [2, 2], [1, 1], [0, 0]]


def wall_map(x: float = 1.0, gap: float = 0.0) -> OccupancyGrid:
    """A room of 4 m with a wall across it at ``x``, with a gap in its middle."""
    data = np.zeros((80, 80), np.int8)
    data[[0, -1]] = data[:, [0, -1]] = 100
    column, half = round((x + 2.0) / 0.05), round(gap / 0.1)
    data[:, column] = 100
    data[40 - half : 40 + half, column] = 0
    return OccupancyGrid(data, 0.05, (-2.0, -2.0))


def test_distances_are_updated_by_parts():
    """As if they were computed anew, whatever is entered: to the nearest mean end of rays."""
    grid = GridMap()
    costmap = Costmap(grid, 0.2)
    generator = np.random.default_rng(0)
    for number in range(6):
        pose = PlanarPose(*generator.uniform(-1.0, 1.0, 3))
        scan = room_scan(pose, half=2.02 - 0.3 * (number > 3))
        costmap.update(grid.enter(scan, scan.points, pose))
    anew = Costmap(grid, 0.2)
    anew.update(grid.whole)
    ours, theirs = costmap.distances, anew.distances
    assert np.abs(ours - theirs).max() < 0.06  # cells at edges of walls stay occupied for longer
    assert np.abs(ours - theirs).mean() < 0.002
    tree = cKDTree(grid.walls())
    for fine, distances in ((1, anew.distances), (2, anew.fine)):
        step, shape = grid.resolution / fine, distances.shape
        places = (np.indices(shape).T[..., ::-1] + 0.5) * step + grid.origin
        exact = np.minimum(tree.query(places)[0].T, 1.0)
        assert shape == tuple(fine * np.array(grid.shape))
        assert np.abs(distances - exact).max() < 0.3 * grid.resolution
        assert np.abs(distances - exact).mean() < 1e-4


def test_costs_are_those_of_nav2():
    navigator = Navigator(vehicle(), PlanarPose(), known=wall_map())
    costs = navigator.costs().data
    assert costs.dtype == np.uint8 and costs.shape == (80, 80)
    assert costs[40, 60] == 254 and costs[40, 58] == 253 and costs[40, 20] == 0
    radius = vehicle().half_width - 0.0025  # a quarter of a cell less, and 1 cm more
    assert costs[40, 52] == pytest.approx(252.0 * math.exp(-3.0 * (0.4 - radius)), abs=1.0)


# Plans --------------------------------------------------------------------------------------------


def test_a_plan_goes_through_the_gap():
    navigator = Navigator(vehicle(), PlanarPose(), known=wall_map(gap=0.6))
    path = navigator.plan(PlanarPose(1.5, 1.0), PlanarPose(-1.0, 1.0))
    assert path[0] == pytest.approx([-1.0, 1.0], abs=0.05)
    assert path[-1] == pytest.approx([1.5, 1.0], abs=0.05)
    through = path[np.abs(path[:, 0] - 1.0).argmin()]
    assert abs(through[1]) < 0.15
    steps = np.hypot(*np.diff(path, axis=0).T)
    assert steps.max() < 0.08


@pytest.mark.parametrize(
    ("goal", "start", "failure"),
    [
        ((1.0, 0.5), (0.0, 0.0), Failure.GOAL_OCCUPIED),
        ((9.0, 0.0), (0.0, 0.0), Failure.GOAL_OUTSIDE_MAP),
        ((1.5, 0.0), (0.0, 0.0), Failure.NO_VALID_PATH),
        ((0.0, 1.0), (1.0, 0.5), None),
        ((0.0, 1.0), (-1.0, -0.5), Failure.START_OCCUPIED),
        ((math.nan, 0.0), (0.0, 0.0), Failure.NO_VALID_PATH),
    ],
)
def test_plans_that_fail_say_why(goal, start, failure):
    grid = wall_map()
    grid.data[20:40, 10:30] = 100
    navigator = Navigator(vehicle(), PlanarPose(), known=grid)
    if failure is None:  # it starts beside the wall that it touches, and leaves it
        assert len(navigator.plan(PlanarPose(*goal), PlanarPose(*start)))
        return
    with pytest.raises(NavigationError) as error:
        navigator.plan(PlanarPose(*goal), PlanarPose(*start))
    assert error.value.failure is failure and str(error.value) == failure.value


# Commands -----------------------------------------------------------------------------------------


def ahead(distances=None, pose=ORIGIN, speed=(0.0, 0.0, 0.0)) -> Situation:
    """A goal far ahead, on free ground or with given distances."""
    distances = np.full((160, 160), 1.0, np.float32) if distances is None else distances
    field = np.tile(5.0 - np.arange(-1.975, 2.0, 0.05), (80, 1))
    no_path = np.zeros((0, 2))
    return Situation(pose, speed, (5.0, 0.0), distances, field, 10.0, (-2.0, -2.0), 0.05, no_path)


def test_it_drives_down_the_field():
    planner, now = LocalPlanner(vehicle()), ahead(pose=PlanarPose(-1.0))
    for _ in range(10):
        (forward, left, turning), free = planner.command(now)
        assert free and left == 0.0
        now = now._replace(speed=(forward, 0.0, turning))
    assert forward > 0.4 and abs(turning) < 0.5


def test_it_turns_when_the_way_is_behind_it():
    planner, now = LocalPlanner(vehicle()), ahead(pose=PlanarPose(0.0, 0.0, math.pi))
    turned = 0.0
    for _ in range(60):
        command, _ = planner.command(now)
        pose = now.pose.compose(PlanarPose(0.05 * command[0], 0.0, 0.05 * command[2]))
        now = now._replace(pose=pose, speed=command)
        turned += abs(0.05 * command[2])
    assert abs(math.remainder(now.pose.yaw, math.tau)) < 0.7 and turned > 2.0


def test_a_car_keeps_its_radius():
    planner = LocalPlanner(vehicle(minimum_radius=0.8))
    for yaw in (0.0, 2.0, math.pi):
        now = ahead(pose=PlanarPose(0.0, 0.0, yaw), speed=(0.3, 0.0, 0.0))
        (forward, _, turning), _ = planner.command(now)
        assert abs(turning) <= abs(forward) / 0.8 + 1.0  # the limiter clips the rest
    paths = planner._roll_out(np.ones((20, 3, 1), np.float32), ahead())
    curves = paths.speeds[:, 2] / np.maximum(paths.speeds[:, 0], 1e-6)
    assert curves.max() <= 1.0 / 0.8 + 1e-5


def test_it_brakes_before_a_wall():
    """However fast it is, no command is given from which it could not stop."""
    planner = LocalPlanner(vehicle(forward=2.0, acceleration=2.0))
    grid = GridMap.of(wall_map(1.0))
    costmap = Costmap(grid, 0.16)
    costmap.update(grid.whole)
    now, speed = ahead(costmap.fine, PlanarPose(-1.5)), 0.0
    for _ in range(120):
        (forward, _, _), free = planner.command(now)
        wanted = forward if free else 0.0
        speed += min(max(wanted - speed, -0.1), 0.1)
        now = now._replace(pose=PlanarPose(now.pose.x + 0.05 * speed), speed=(speed, 0.0, 0.0))
        assert planner.clearance(now) > -0.01
    assert now.pose.x > 0.3  # it came near


def test_the_clearance_before_a_wall_is_continuous():
    """It does not jump from cell to cell: the last centimeter decides whether something touches."""
    grid = GridMap.of(wall_map(1.0))
    costmap = Costmap(grid, 0.16)
    costmap.update(grid.whole)
    planner, places = LocalPlanner(vehicle()), np.arange(0.75, 0.9, 0.004)
    found = [planner.clearance(ahead(costmap.fine, PlanarPose(x))) for x in places]
    assert np.diff(found) == pytest.approx(-0.004, abs=5e-4)
    assert found[0] == pytest.approx(1.025 - 0.75 - 0.1, abs=0.015)


# The navigator ------------------------------------------------------------------------------------


def test_bad_goals_are_refused():
    navigator = Navigator(vehicle(), PlanarPose())
    for bad in ((math.nan, 0.0), (0.0, math.inf), (0.0, 0.0, math.nan)):
        with pytest.raises(ValueError, match="finite"):
            navigator.go_to(*bad)


class Toy:
    """A robot that drives exactly as commanded, in a square room."""

    def __init__(self, navigator: Navigator, half: float = 2.02) -> None:
        self.navigator, self.half = navigator, half
        self.pose, self.time, self.speed = navigator.pose, 0.0, (0.0, 0.0, 0.0)

    def run(self, seconds: float = 60.0, *, blind: bool = False) -> None:
        end = self.time + seconds
        while self.time < end:
            scan = None if blind else room_scan(self.pose, self.half)
            command = self.navigator.update(self.time, self.pose, self.speed, scan=scan)
            limits = (0.05, 0.05, 0.15)
            self.speed = tuple(
                now + min(max(wanted - now, -most), most)
                for now, wanted, most in zip(self.speed, command, limits, strict=True)
            )
            self.pose = self.pose.compose(PlanarPose(*(0.05 * part for part in self.speed)))
            self.time += 0.05
            if not self.navigator.navigating:
                break


def test_a_motion_ends_where_it_was_to():
    toy = Toy(Navigator(vehicle(), PlanarPose()))
    toy.navigator.drive_straight(-0.4, 0.2, time_allowance=-1.0)  # no limit, as in Nav2
    toy.run()
    assert toy.navigator.status == "arrived" and toy.pose.x == pytest.approx(-0.4, abs=0.02)
    assert toy.navigator.traveled == pytest.approx(0.4, abs=0.02)
    toy.navigator.spin(-7.0)
    toy.run()
    assert toy.navigator.status == "arrived" and toy.pose.yaw == pytest.approx(-7.0, abs=0.03)


def test_a_motion_stops_before_a_wall():
    toy = Toy(Navigator(vehicle(), PlanarPose()))
    toy.navigator.drive_straight(5.0, 0.5)
    toy.run()
    assert toy.navigator.failure is Failure.COLLISION_AHEAD
    assert 1.0 < toy.pose.x < 1.92


def test_a_path_is_followed():
    """It leaves the straight line to the end for the corner of the path."""
    toy = Toy(Navigator(vehicle(), PlanarPose()))
    toy.navigator.follow(np.array([(0.0, 0.0), (1.2, 0.0), (1.2, 1.2)]), math.pi / 2.0)
    worst = 0.0
    while toy.navigator.navigating and toy.time < 60.0:
        toy.run(0.05)
        worst = max(worst, toy.pose.x - toy.pose.y)
    assert toy.navigator.status == "arrived" and worst > 0.6
    assert toy.pose == pytest.approx((1.2, 1.2, math.pi / 2.0), abs=0.1)


def test_time_runs_out():
    limited = NavigationParameters(time_allowance=1.0)
    toy = Toy(Navigator(vehicle(), PlanarPose(), parameters=limited))
    toy.navigator.go_to(1.5, 0.0)
    toy.run()
    assert toy.navigator.failure is Failure.TIMEOUT and 1.0 <= toy.time < 1.2


def test_it_stands_without_scans_and_goes_on():
    toy = Toy(Navigator(vehicle(), PlanarPose()))
    toy.navigator.go_to(1.0, 0.5)
    toy.run(1.0)
    driven = toy.pose.x
    toy.run(1.0, blind=True)
    assert toy.navigator.status == "blocked" and "no scan" in toy.navigator.reason
    assert toy.speed == (0.0, 0.0, 0.0) and 0.0 < driven < toy.pose.x < driven + 0.4
    toy.run()
    assert toy.navigator.status == "arrived"
    assert toy.pose[:2] == pytest.approx((1.0, 0.5), abs=0.05)


def test_it_stands_when_scans_and_odometry_end():
    toy = Toy(Navigator(vehicle(), PlanarPose()))
    toy.navigator.go_to(1.0, 0.5)
    toy.run(1.0)
    last = toy.navigator.time, toy.pose, toy.speed
    commands = [toy.navigator.update(*last) for _ in range(8)]
    assert commands[0][0] > 0.1 and commands[-1] == (0.0, 0.0, 0.0)
    toy.run()
    assert toy.navigator.status == "arrived"


def test_odometry_that_jumps_is_corrected():
    toy = Toy(Navigator(vehicle(), PlanarPose()))
    toy.navigator.go_to(0.5, 0.0)
    toy.run()
    here = toy.pose
    for time, odometry in ((9.0, here), (9.05, PlanarPose(5.0, 3.0, 1.0))):
        toy.navigator.update(time, odometry, (0.0, 0.0, 0.0), scan=room_scan(here))
    assert toy.navigator.pose == pytest.approx(here, abs=0.03)


@pytest.mark.parametrize(
    ("goal", "failure"),
    [((1.5, 1.0), Failure.NO_VALID_PATH), ((0.8, 0.0), Failure.GOAL_OCCUPIED)],
)
def test_it_gives_up(goal, failure):
    """Where there is no way after a while, and at once where the goal is in an obstacle."""
    grid = wall_map(0.8)
    navigator = Navigator(vehicle(), PlanarPose(), known=grid)
    points = np.full(360, np.inf, np.float32)
    time = 0.0
    navigator.go_to(*goal)
    while navigator.navigating and time < 20.0:
        scan = room_scan()._replace(ranges=points)
        navigator.update(time, PlanarPose(), (0.0, 0.0, 0.0), scan=scan._replace(reach=0.3))
        time += 0.05
    assert navigator.failure is failure and navigator.reason == failure.value
    assert (time > 5.0) == (failure is Failure.NO_VALID_PATH)


def fenced_in() -> tuple[Navigator, LevelScan]:
    """A robot that has seen something all around it, and now sees only what is near."""
    navigator = Navigator(vehicle(), PlanarPose(), known=wall_map(1.8))
    for cycle in range(20):
        navigator.update(0.05 * cycle, ORIGIN, (0.0, 0.0, 0.0), scan=room_scan(half=1.02))
    with pytest.raises(NavigationError, match="no path"):
        navigator.plan(PlanarPose(1.5, 0.0))
    return navigator, room_scan()._replace(ranges=np.full(360, np.inf, np.float32), reach=0.3)


def test_what_has_moved_is_forgotten_where_there_is_no_path():
    navigator, scan = fenced_in()
    navigator.go_to(1.5, 0.0)
    waiting = 0.0
    while navigator.status != "driving" or not len(navigator.path):
        waiting += 0.05
        command = navigator.update(1.0 + waiting, ORIGIN, (0.0, 0.0, 0.0), scan=scan)
        assert waiting < 6.0 and (len(navigator.path) or command == (0.0, 0.0, 0.0))
    assert waiting > 3.9 and navigator.recoveries == 1


def test_what_is_forgotten_near_the_robot_no_longer_costs():
    navigator, scan = fenced_in()
    navigator.update(1.0, ORIGIN, (0.0, 0.0, 0.0), scan=scan)
    navigator.forget_near(1.2)
    assert len(navigator.plan(PlanarPose(1.5, 0.0))) > 20


def test_it_touches_nothing_on_its_way_to_a_goal_where_it_does_not_fit():
    """Scans do not measure what is beside the robot, and so it must not be forgotten."""
    footprint = np.array([(-0.33, -0.15), (0.1, -0.15), (0.1, 0.15), (-0.33, 0.15)])
    toy = Toy(Navigator(Vehicle(footprint, 0.5, 0.2, 0.0, 2.0, 1.0, 3.0), ORIGIN), half=0.42)
    toy.navigator.go_to(-0.05, -0.16, 1.6)
    room = math.inf
    while toy.navigator.navigating and toy.time < 60.0:
        toy.run(0.05)
        room = min(room, 0.42 - np.abs(placed(footprint, toy.pose)).max())
    assert toy.navigator.failure is Failure.FAILED_TO_MAKE_PROGRESS
    assert toy.navigator.recoveries > 3 and room > 0.0
