"""Simulated robots that find their way by their own scans."""

import math
from pathlib import Path

import numpy as np
import pytest
from scipy.ndimage import binary_dilation

from onebot_control import OneBotError, Simulation
from tests.onebot_control import drive_models

LIMITS = {"linear.x.max_velocity": 0.5}
GOAL = 0.1, 1.7, 1.57  # in the second row of the maze


def maze(**arguments) -> Simulation:
    return Simulation(world="maze", sensors=True, parameters=LIMITS, y=0.8, **arguments)


def arrive(simulation: Simulation, timeout: float = 60.0) -> str:
    robot = simulation.robot
    simulation.run(until=lambda: not robot.navigating, timeout=timeout)
    return robot.navigation.status


def off(robot) -> tuple[float, float]:
    """How far the navigator's pose is from the true one, m and rad."""
    known, pose = robot.navigation.navigator.pose, robot.pose
    turn = math.remainder(known.yaw - pose.yaw, math.tau)
    return math.hypot(known.x - pose.x, known.y - pose.y), abs(turn)


@pytest.fixture(scope="module")
def driven():
    """OneBot has driven to the goal, and what it was at on the way."""
    with maze() as simulation:
        robot, way = simulation.robot, []
        robot.go_to(*GOAL)
        simulation.on_step(lambda: way.append((robot.pose, *off(robot), len(robot.path))))
        status = arrive(simulation)
        yield simulation, status, way


def test_it_arrives(driven):
    simulation, status, way = driven
    robot, (x, y, yaw) = simulation.robot, GOAL
    assert status == "arrived" and robot.navigation.reason == "" and not robot.navigating
    assert math.hypot(robot.pose.x - x, robot.pose.y - y) < 0.05
    assert abs(robot.pose.yaw - yaw) < 0.1
    assert not robot.collided
    assert len(robot.path) == 0 and max(points for *_, points in way) > 15
    simulation.run(1.0)
    assert abs(robot.twist.linear) < 1e-3  # it stands there


def test_it_knows_where_it_is(driven):
    _, _, way = driven
    # It is updated in each fifth cycle.
    away, turn = np.quantile([row[1:3] for row in way[4::5]], 0.95, axis=0)
    assert away < 0.03 and turn < 0.01


def test_its_map_is_that_of_the_maze(driven):
    """At least 98 % of the cells that it knows, but for the edges of walls."""
    simulation, _, _ = driven
    grid = simulation.robot.navigation.navigator.map.occupancy()
    rows, columns = grid.data.shape
    x, y = grid.origin
    bounds = x, y, x + columns * grid.resolution, y + rows * grid.resolution
    truth = simulation.occupancy_grid(grid.resolution, bounds=bounds).data[:rows, :columns] > 0
    # A wall's face may lie on an edge of cells: then either of them is right.
    wide, narrow = binary_dilation(truth), ~binary_dilation(~truth)
    known = (grid.data >= 0) & wide == narrow
    known &= grid.data >= 0
    assert known.sum() > 1000
    assert ((grid.data > 0) == truth)[known].mean() > 0.98


def test_each_run_is_bit_identical(driven):
    _, _, way = driven
    with maze() as simulation:
        robot = simulation.robot
        robot.go_to(*GOAL)
        simulation.run(4.0)
        poses = robot.pose
        simulation.reset()
        assert not robot.navigating and robot.navigation.status == "idle"
        robot.go_to(*GOAL)
        simulation.run(4.0)
        assert robot.pose == poses == way[399][0]


def test_whoever_drives_takes_over():
    with maze() as simulation:
        robot = simulation.robot
        assert robot.navigation.status == "idle" and len(robot.path) == 0
        robot.go_to(*GOAL)
        simulation.run(1.0)
        assert robot.navigating and robot.command.linear > 0.05
        robot.drive(-0.1)
        assert robot.navigation.status == "cancelled" and "took over" in robot.navigation.reason
        simulation.run(1.0)
        assert robot.command.linear == pytest.approx(-0.1)
        robot.go_to(*GOAL)
        robot.navigation.cancel()
        simulation.run(1.0)
        assert robot.command.linear == 0.0 and not robot.navigating


def test_it_is_told_where_it_was_teleported():
    with maze() as simulation:
        robot = simulation.robot
        robot.teleport(0.8, 0.8, 1.0)
        robot.go_to(2.4, 0.8)
        simulation.run(0.5)
        assert off(robot)[0] < 0.01
        robot.teleport(1.6, 0.8, 2.0)
        simulation.run(0.5)
        assert off(robot)[0] < 0.01 and robot.navigating


def test_in_another_world_it_begins_anew():
    """A reset that builds another world ends the goal; the next one is reached there."""
    with Simulation(sensors=True) as simulation:
        robot = simulation.robot
        robot.go_to(5.0, 0.0)
        simulation.run(1.0)
        simulation.reset(world="maze")
        assert robot.navigation.status == "idle"
        robot.go_to(0.2, 0.0)
        assert arrive(simulation) == "arrived" and robot.pose.x > 0.15


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({}, r"no level lidar.*Simulation\(sensors=True\) gives OneBot"),
        ({"model": "package://mrm_description/urdf/mrm.xacro"}, "no wheels to drive on"),
    ],
)
def test_robots_that_cannot_are_refused(arguments, message):
    with Simulation(**arguments) as simulation, pytest.raises(OneBotError, match=message):
        simulation.robot.go_to(1.0, 0.0)


LIDAR = """<robot name="lidar"><gazebo reference="base"><sensor name="lidar" type="gpu_lidar">
<pose>0 0 0.25 {roll} 0 0</pose><update_rate>10</update_rate><topic>scan</topic><lidar><scan>
<horizontal><samples>360</samples><min_angle>-3.14159265</min_angle><max_angle>3.124139</max_angle>
</horizontal></scan><range><min>0.05</min><max>12</max></range>
<noise><type>gaussian</type><stddev>0.01</stddev></noise></lidar></sensor></gazebo></robot>"""


def lidar(folder: Path, roll: float = 0.0) -> str:
    file = folder / "lidar.urdf"
    file.write_text(LIDAR.format(roll=roll))
    return str(file)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "roll"),
    [("omni", 0.0), ("car", math.pi), ("tricycle", 0.0)],
)
def test_other_drives_cross_a_cluttered_world(tmp_path, kind, roll):
    """Those that turn on the spot arrive with a heading, too; a lidar may hang upside down."""
    model = getattr(drive_models, kind)()
    world = "clutter:seed=1,density=0.2,radius=0.4"
    with Simulation(model, world=world, sensors=lidar(tmp_path, roll)) as simulation:
        robot, holonomic = simulation.robot, kind in ("mecanum", "omni")
        robot.go_to(8.5, 0.0, 1.0 if holonomic else None)
        assert arrive(simulation, 90.0) == "arrived" and not robot.collided
        near = 0.05 if holonomic else 0.15
        assert math.hypot(robot.pose.x - 8.5, robot.pose.y) < near
        assert not holonomic or robot.pose.yaw == pytest.approx(1.0, abs=0.1)


@pytest.mark.slow
def test_goals_in_the_maze():
    with Simulation(world="maze", sensors=True, parameters=LIMITS) as simulation:
        robot = simulation.robot
        # At the second, there is no room to turn: it has to turn before.
        for goal in ((2.4, 2.4, 1.57), (1.52, 0.32, -2.72)):
            robot.go_to(*goal)
            assert arrive(simulation, 120.0) == "arrived", (goal, robot.navigation.reason)
            assert math.hypot(robot.pose.x - goal[0], robot.pose.y - goal[1]) < 0.05
            assert abs(math.remainder(robot.pose.yaw - goal[2], math.tau)) < 0.1
        assert not robot.collided
