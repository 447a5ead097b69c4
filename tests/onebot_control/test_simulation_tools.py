"""What a Simulation has for tests and studies: steps, a log, pushes, pictures, a true map."""

import math
from pathlib import Path

import numpy as np
import pytest

from onebot_control import Moment, OccupancyGrid, OneBotError, RobotSetup, Simulation
from onebot_description.description import parse_description
from onebot_description.model import RobotModel
from tests.onebot_control.arm_models import GRAVITY, MRM
from tests.onebot_control.test_contacts import GRIPPER, crate, wall, world

DIFF_DRIVE = Path(__file__).parents[1] / "robots" / "diff_drive.urdf"
MASS = 4.0  # kg, of that robot
JOINT = "base_link__link_01"


def test_steps_and_functions_that_are_called_after_each():
    with Simulation(DIFF_DRIVE) as simulation:
        times: list[float] = []
        end = simulation.on_step(lambda: times.append(simulation.time))
        simulation.step()
        simulation.step(3)
        simulation.step(0)
        assert times == [0.01, 0.02, 0.03, 0.04]
        simulation.run(0.02)
        assert times[-1] == simulation.time == 0.06
        end()
        end()
        simulation.step(2)
        assert len(times) == 6

        def fail() -> None:
            raise RuntimeError("mine")

        simulation.on_step(fail)
        with pytest.raises(RuntimeError, match="mine"):
            simulation.run(1.0)
        assert simulation.time == pytest.approx(0.09)


def test_a_log_is_arrays_of_poses_and_joints():
    with Simulation(world="maze", y=0.8) as simulation:
        robot = simulation.robot
        assert simulation.log == {} and simulation.moments == ()
        simulation.record()
        robot.drive(0.5)
        simulation.run(2.0)
        log = simulation.log
        assert {len(column) for column in log.values()} == {201}
        assert log["time"] == pytest.approx(np.arange(201) / 100.0)
        assert (log["x"][0], log["x"][-1]) == (0.0, robot.pose.x)
        assert (log["y"][-1], log["yaw"][-1]) == (robot.pose.y, robot.pose.yaw)
        wheel = robot.joints["left_wheel_joint"].position
        assert log["joints.left_wheel_joint"][-1] == wheel != 0.0
        assert log["boxes.crate.x"] == pytest.approx(np.full(201, 1.52), abs=1e-3)
        assert np.gradient(log["x"], log["time"])[-1] == pytest.approx(0.5, abs=0.01)
        last = simulation.moments[-1]
        assert isinstance(last, Moment) and last.time == 2.0 and last.stamp == 2_010_000_000
        simulation.reset()
        assert simulation.log["time"].tolist() == [0.0]
        simulation.record(seconds=0.5, rate=20.0)
        simulation.run(3.0)
        assert simulation.log["time"] == pytest.approx(np.arange(2.55, 3.01, 0.05))
    robots = {"a": RobotSetup(model=DIFF_DRIVE), "b": RobotSetup(y=1.0, model=DIFF_DRIVE)}
    with Simulation(robots=robots) as simulation:
        simulation.record()
        simulation.step()
        assert simulation.log["b.y"] == pytest.approx([1.0, 1.0])
        assert "a.joints.left_wheel_joint" in simulation.log


def _center(simulation: Simulation) -> np.ndarray:
    """The center of mass of a robot in its root link's frame, which is level."""
    description = simulation.robot.description
    poses = RobotModel.from_description(description).link_matrices({})
    parts = [(poses[link.name], link.inertial) for link in description.links if link.inertial]
    moments = [one.mass * (pose @ [*one.origin.xyz, 1.0])[:3] for pose, one in parts]
    assert sum(one.mass for _, one in parts) == pytest.approx(MASS)
    return np.sum(moments, axis=0) / MASS


def test_a_push_accelerates_by_its_force():
    """Twice the weight upwards for 0.2 s, then thrown: by v = g t, s = v^2 / 2 g."""
    with Simulation(DIFF_DRIVE) as simulation:
        robot = simulation.robot
        start = robot.pose.z
        robot.push((0.0, 0.0, 2.0 * MASS * GRAVITY), 0.2, point=_center(simulation))
        simulation.run(0.2)
        assert not robot.contacts
        assert robot.pose.z - start == pytest.approx(GRAVITY * 0.2**2 / 2.0, rel=0.03)
        simulation.run(0.2)
        assert robot.pose.z - start == pytest.approx(GRAVITY * 0.2**2, rel=0.03)
        assert abs(robot.pose.pitch) < 0.01
        simulation.run(1.0)
        assert robot.pose.z == pytest.approx(start, abs=1e-3)
        # Above its axle it stays where it is, up to the friction of what its wheels carry.
        before = robot.pose.y
        robot.push((0.0, 0.4 * MASS * GRAVITY, 0.0), 0.5, point=(0.0, 0.0, 0.0))
        simulation.run(0.5)
        assert robot.pose.y == pytest.approx(before, abs=2e-3)
        robot.push((0.0, 3.0 * MASS * GRAVITY, 0.0), 0.1, point=(-0.1, 0.0, -0.05))
        simulation.run(0.2)
        assert robot.pose.y > 0.02
        robot.push((0.0, 500.0, 0.0), 9.0)
        robot.teleport(0.0, 0.0)  # ends it
        simulation.run(0.1)
        assert abs(robot.pose.y) < 1e-4


def test_a_push_on_an_arm_loads_its_motor():
    """5 N across, at a point of the link: the joint's effort is the lever arm times the force."""
    with Simulation(MRM) as simulation:
        robot = simulation.robot
        simulation.run(0.5)
        before = robot.joints[JOINT].effort
        [axis] = [joint.axis for joint in robot.description.joints if joint.name == JOINT]
        at, force = np.array([0.1, 0.05, 0.02]), np.array([3.0, -4.0, 2.0])
        robot.push(force, 1.0, link="link1", point=at)
        simulation.run(0.5)
        torque = float(np.cross(at, force) @ np.array(axis))
        assert robot.joints[JOINT].effort - before == pytest.approx(-torque, rel=0.01)
        with pytest.raises(OneBotError, match="is fixed"):
            robot.push((1.0, 0.0, 0.0), 1.0)


def test_joints_are_set_at_rest_and_held_there():
    with Simulation(MRM) as simulation:
        robot = simulation.robot
        robot.move_to({JOINT: 0.5}, seconds=1.0)
        simulation.run(0.5)
        robot.set_joints({JOINT: -0.4})
        assert robot.joints[JOINT].position == -0.4 and robot.joints[JOINT].velocity == 0.0
        assert not robot.moving
        simulation.run(1.0)
        assert robot.joints[JOINT].position == pytest.approx(-0.4, abs=1e-8)
        robot.move_to({JOINT: 0.1}, seconds=3.0)
        simulation.run(until=lambda: not robot.moving)
        assert robot.joints[JOINT].position == pytest.approx(0.1, abs=1e-8)
        for positions, message in (
            ({"joint": 0.1}, 'joint "joint" cannot be set'),
            ({JOINT: 99.0}, "99.0 is not from"),
            ({JOINT: math.nan}, "nan"),
        ):
            with pytest.raises(OneBotError, match=message):
                robot.set_joints(positions)
        assert robot.joints[JOINT].position == pytest.approx(0.1, abs=1e-8)


def test_wheels_are_set_without_any_way():
    with Simulation(DIFF_DRIVE) as simulation:
        robot = simulation.robot
        robot.drive(0.3)
        simulation.run(2.0)
        before = robot.odometry
        robot.set_joints({"left_wheel_joint": 1.0})
        assert robot.joints["left_wheel_joint"].position == 1.0
        assert (robot.odometry.x, robot.odometry.yaw) == (before.x, before.yaw)
        simulation.run(1.0)
        assert robot.odometry.x - before.x == pytest.approx(0.3, abs=0.02)


def test_joints_are_not_set_into_what_is_there():
    scene = world(wall("shelf", "0.5 0.5 0.02", "0 0 0.25"))
    with Simulation(parse_description(GRIPPER), world=scene) as simulation:
        robot = simulation.robot
        with pytest.raises(OneBotError, match="link shelf of .* there; nothing has moved"):
            robot.set_joints({"lift": 0.18})
        assert robot.joints["lift"].position == 0.0
        robot.set_joints({"lift": 0.1})
        assert robot.joints["lift"].position == 0.1 and not robot.collided


def test_parameters_change_in_a_run_and_a_reset_undoes_it():
    with Simulation(DIFF_DRIVE, parameters={"linear.x.max_velocity": 0.4}) as simulation:
        robot = simulation.robot
        robot.drive(1.0)
        simulation.run(3.0)
        assert robot.twist.linear == pytest.approx(0.4, abs=1e-3)
        robot.set_parameters({"linear.x.max_velocity": 0.1})
        simulation.run(3.0)
        assert robot.twist.linear == pytest.approx(0.1, abs=1e-3)
        for values, message in (
            ({"linear.x.max_velocity": "fast"}, "max_velocity"),
            ({"linear.x.max_velo": 0.2}, "max_velocity"),
            ({"update_rate": 50}, "update_rate: is read at the start"),
            ({"world": "maze"}, "world: has no effect here"),
        ):
            with pytest.raises(OneBotError, match=message):
                robot.set_parameters(values)
        simulation.run(0.1)
        assert robot.twist.linear == pytest.approx(0.1, abs=1e-3)
        simulation.reset()
        robot.drive(1.0)
        simulation.run(3.0)
        assert robot.twist.linear == pytest.approx(0.4, abs=1e-3)


def test_a_map_of_the_ground_truth():
    """By arithmetic: a wall of one cell, a crate where it was pushed, a shelf that is above."""
    scene = world(
        wall("wall", "0.1 1.0 0.5", "1.05 0.5 0.25"),
        wall("shelf", "1 1 0.1", "0 0 2"),
        crate("box", 1.0, "0.2 0.2 0.2", "0.5 0 0.1"),
    )
    with Simulation(DIFF_DRIVE, world=scene, x=-2.0) as simulation:
        grid = simulation.occupancy_grid(0.1, bounds=(-1.0, -1.0, 2.0, 1.0))
        assert isinstance(grid, OccupancyGrid)
        assert (grid.origin, grid.resolution, grid.data.dtype) == ((-1.0, -1.0), 0.1, np.int8)
        expected = np.zeros((20, 30), np.int8)
        expected[10:20, 20] = 100  # y 0 to 1, x 1.0 to 1.1
        expected[9:11, 14:16] = 100
        assert np.array_equal(grid.data, expected)
        fitting = simulation.occupancy_grid(0.1)
        assert fitting.origin == pytest.approx((0.4, -0.1))
        assert np.array_equal(fitting.data, expected[9:, 14:21])
        assert (simulation.occupancy_grid(0.1, height=2.0).data == 100).all()
        robot = simulation.robot
        robot.drive(0.5)
        simulation.run(until=lambda: simulation.boxes["box"].x > 0.6, timeout=20.0)
        moved = simulation.occupancy_grid(0.1, bounds=(-1.0, -1.0, 2.0, 1.0))
        assert moved.data[10, 16] == 100 and moved.data[10, 14] == 0
        with pytest.raises(OneBotError, match="larger resolution"):
            simulation.occupancy_grid(1e-6)
    with Simulation(DIFF_DRIVE) as bare:
        assert not bare.occupancy_grid(bounds=(0.0, 0.0, 1.0, 0.5)).data.any()


def test_pictures_from_anywhere():
    """A red box is in the middle, seen from a side, and from straight above with y upwards."""
    red = '<visual><geometry><box size="0.4 0.4 0.4"/></geometry>'
    red += '<material name="red"><color rgba="1 0 0 1"/></material></visual>'
    place = '<joint name="j" type="fixed"><parent link="world"/><child link="box"/>'
    place += '<origin xyz="0 2 0.2"/></joint>'
    with Simulation(DIFF_DRIVE, world=world(f'<link name="box">{red}</link>', place)) as simulation:

        def is_red(picture: np.ndarray) -> np.ndarray:
            return (picture[..., 0] > 100) & (picture[..., 1] < 50)

        picture = simulation.picture((3.0, 2.0, 0.5), (0.0, 2.0, 0.2))
        assert (picture.shape, picture.dtype) == ((480, 640, 3), np.uint8)
        assert is_red(picture)[240, 320] and not is_red(picture)[240, 20]
        above = is_red(simulation.picture((0, 0, 6), (0, 0, 0), width=200, height=200))
        rows, columns = np.nonzero(above)
        assert rows.mean() < 60 and abs(columns.mean() - 100) < 2
