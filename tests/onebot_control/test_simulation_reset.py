"""A reset with other arguments is equal to a new Simulation with them."""

import re
from pathlib import Path
from typing import Any

import pytest

from onebot_control import RobotSetup, Simulation
from onebot_description.errors import OneBotError

BOX = """<robot name="box"><link name="box"><collision><origin xyz="{x} 0 0.5"/>
<geometry><box size="0.2 2 1"/></geometry></collision><visual><origin xyz="{x} 0 0.5"/>
<geometry><box size="0.2 2 1"/></geometry></visual></link></robot>"""


def driven(simulation: Simulation) -> tuple[object, ...]:
    """What a drive ends with; equal for worlds that are bit-identical."""
    robot = simulation.robot
    robot.drive(0.4, 0.3)
    simulation.run(0.5)
    imu = robot.imu()
    measured = robot.scan().ranges.tobytes(), imu.linear_acceleration.tobytes()
    return robot.pose, robot.twist, robot.odometry.x, measured, simulation.time, robot.collided


def test_a_reset_with_other_arguments_is_equal_to_a_new_simulation() -> None:
    """Whatever has changed before: start, seed, parameters, those read at the start, world."""
    arguments: dict[str, Any] = {"sensors": True, "world": "maze"}
    with Simulation(**arguments) as simulation:
        simulation.record(rate=10.0)
        for changed in (
            {"y": 0.8, "yaw": 0.3},
            {"parameters": {"linear.x.max_velocity": 0.2}},
            {"world": "", "seed": 3},
            {"world": "maze", "x": 0.1},
            {"parameters": {"update_rate": 50, "wheel_separation": 0.31}},
            {"x": 0.0, "y": 0.0, "yaw": 0.0, "parameters": {}, "seed": 0},
        ):
            driven(simulation)
            arguments.update(changed)
            simulation.reset(**changed)
            assert [moment.time for moment in simulation.moments] == [0.0]
            with Simulation(**arguments) as new:
                assert driven(simulation) == driven(new), changed
                assert (simulation.seed, simulation.period) == (new.seed, new.period)
            simulation.reset()
            with Simulation(**arguments) as new:
                assert driven(simulation) == driven(new), changed


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"x": 3.0, "y": 0.8, "parameters": {"linear.x.max_velocity": 0.1}}, "cannot stand there"),
        ({"parameters": {"linear.x.max_velocty": 0.1}}, "linear.x.max_velocty: no such parameter"),
        ({"parameters": {"wheel_separation": -1.0}, "y": 0.5}, "wheel_separation: -1 is below 0"),
        ({"x": 1e9}, "up to"),
    ],
)
def test_a_refused_reset_changes_nothing(changed: dict[str, Any], words: str) -> None:
    with Simulation(world="maze", sensors=True) as simulation:
        simulation.run(0.5)
        pose = simulation.robot.pose
        with pytest.raises(OneBotError, match=re.escape(words)):
            simulation.reset(seed=5, **changed)
        assert (simulation.robot.pose, simulation.time, simulation.seed) == (pose, 0.5, 0)
        simulation.reset()
        with Simulation(world="maze", sensors=True) as new:
            assert driven(simulation) == driven(new)


def test_several_robots_have_their_own_starts() -> None:
    setups = {"one": RobotSetup(), "two": RobotSetup(x=1.0)}
    with Simulation(robots=setups) as simulation:
        with pytest.raises(OneBotError, match="for a single robot"):
            simulation.reset(x=1.0)
        simulation.reset(parameters={"linear.x.max_velocity": 0.1})
        with Simulation(robots=setups, parameters={"linear.x.max_velocity": 0.1}) as new:
            for each in (simulation, new):
                each.robots["two"].drive(0.5)
                each.run(1.0)
            assert simulation.robots["two"].pose == new.robots["two"].pose
            assert simulation.robots["two"].twist.linear < 0.11


def test_a_file_that_was_edited_is_read_again(tmp_path: Path) -> None:
    """Descriptions are kept from one simulation to the next, as long as their files are."""
    file = tmp_path / "wall.urdf"
    for x in (1.0, 2.0):
        file.write_text(BOX.format(x=x))
        for _ in range(2):
            with Simulation(world=file) as simulation:
                assert simulation.ray([0, 0, 0.5], [1, 0, 0]) == pytest.approx(x - 0.1)
                world = simulation.world
    with Simulation(world=file) as simulation:
        assert simulation.world is world
        file.write_text(BOX.format(x=3.0))
        simulation.reset(world=file)
        assert simulation.ray([0, 0, 0.5], [1, 0, 0]) == pytest.approx(2.9)
