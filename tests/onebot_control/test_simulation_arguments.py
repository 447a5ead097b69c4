"""Wrong arguments of Simulation, its robots and RobotSetup: one sentence names each."""

import inspect
import math
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from onebot_control import OneBotError, RobotSetup, SimulatedRobot, Simulation
from onebot_description import RobotModel, load_description, parse_description

ROBOTS = Path(__file__).parents[1] / "robots"
DIFF_DRIVE, ARM = ROBOTS / "diff_drive.urdf", "package://mrm_description/urdf/mrm.xacro"
TEXT = DIFF_DRIVE.read_text()

WRONG = [
    ({"model": None}, "model: has no value; write a URDF or xacro file, or a Description"),
    ({"model": TEXT}, "is a description; pass the path of its file"),
    ({"model": DIFF_DRIVE, "sensors": True}, "no sensor found"),
    ({"world": None}, 'write the name of a world, a URDF or xacro file, a Description, or ""'),
    ({"x": "1"}, 'x: "1" is a string; write a number'),
    ({"yaw": math.inf}, "yaw: inf is not finite"),
    ({"sensors": None}, "sensors: has no value; write True or False, or a URDF or xacro file"),
    ({"sensors": "nowhere.urdf"}, "nowhere.urdf"),
    ({"noise": "no"}, 'noise: "no" is a string; write True or False'),
    ({"seed": -1}, "seed: -1 is below 0; write an integer from 0 to 2^64 - 1"),
    ({"seed": 2**64}, "seed: needs more than 64 bits; write an integer from 0 to 2^64 - 1"),
    ({"arguments": {"mesh_enabled": None}}, "arguments.mesh_enabled: has no value"),
    ({"parameters": None}, "parameters: has no value; write a dict"),
    ({"parameters": {"linear.x.max_velocity": "1"}}, 'max_velocity: "1" is a string'),
    ({"robots": [RobotSetup()]}, "is a list; write a dict of RobotSetups by name"),
    ({"robots": {"a": {"x": 1}}}, "robots.a: is a map; write a RobotSetup"),
    ({"robots": {"a b": RobotSetup()}}, 'robots: "a b" is not valid; write letters, digits'),
    ({"robots": {"two": RobotSetup(parameters={"nope": 1})}}, "robots.two.nope: no such parameter"),
]


@pytest.mark.parametrize(("arguments", "words"), WRONG)
def test_a_simulation_s(arguments: dict[str, Any], words: str) -> None:
    with pytest.raises(OneBotError) as caught:
        Simulation(**arguments)
    assert words in str(caught.value)


def test_a_robot_setup_s() -> None:
    with pytest.raises(OneBotError, match='x: "1" is a string'):
        RobotSetup(x="1")  # type: ignore[arg-type]


def test_numpy_s_numbers_are_right() -> None:
    parameters = {"linear.x.max_velocity": np.float32(0.3), "update_rate": np.int64(50)}
    seed, x = np.uint64(2**64 - 1), np.float32(0.25)
    with Simulation(DIFF_DRIVE, x=x, seed=seed, parameters=parameters) as one:
        assert one.robot.pose.x == pytest.approx(0.25, abs=1e-6)
        assert one.seed == 2**64 - 1 and type(one.seed) is int
        one.robot.drive(np.float64(1.0), np.int8(0))
        one.run(np.float32(2.0))
        assert one.robot.twist.linear == pytest.approx(0.3, abs=1e-3)
        one.reset(seed=np.int32(5))
        assert one.seed == 5


@pytest.fixture(scope="module")
def sensed() -> Iterator[Simulation]:
    with Simulation(sensors=True) as one:
        yield one


CALLS: list[tuple[Callable[[Simulation], object], str]] = [
    (lambda s: s.run(), "run takes seconds, or until=..."),
    (lambda s: s.run(1.0, until=lambda: True), "run takes seconds, or until=..."),
    (lambda s: s.run(math.inf), "seconds: inf is not finite; write a duration"),
    (lambda s: s.step(-1), "cycles: -1 is below 0; write a number of control cycles"),
    (lambda s: s.step(1.5), "write a number of control cycles"),
    (lambda s: s.on_step(3), "function: 3 is a number; write a function"),
    (lambda s: s.occupancy_grid(0.0), "resolution: 0 is not above 0"),
    (lambda s: s.occupancy_grid(bounds=(0, 0, 0, 1)), "bounds: write bounds: minimum x"),
    (lambda s: s.occupancy_grid(height=9.0), "bounds="),
    (lambda s: s.picture((1, 1, 1), (1, 1, 1)), "target: is the same point as the eye"),
    (lambda s: s.picture((0, 0, 1), (1, 0, 0), width=0), "width: 0 is below 1; write pixels"),
    (lambda s: s.robot.push((0, 0, math.nan), 1.0), "write three finite numbers: x, y, z"),
    (lambda s: s.robot.push((1, 0, 0), 1.0, link="left_weel"), 'no link "left_weel"'),
    (lambda s: s.run("1"), 'seconds: "1" is a string; write a duration'),
    (lambda s: s.run(-1), "seconds: -1 is below 0"),
    (lambda s: s.run(until=True), "until: true is a bool; write a function"),
    (lambda s: s.record(1e30, 1), "seconds: 1e+30 is above"),
    (lambda s: s.record(1, 0), "rate: 0 is not above 0"),
    (lambda s: s.ray((0, 0), (1, 0, 0)), "origin: 2 numbers; write three finite numbers"),
    (lambda s: s.ray((0, 0, 1), (0, 0, 0)), "direction: is zero"),
    (lambda s: s.robots["x"], 'no robot "x"'),
    (lambda s: s.boxes["x"], 'no box "x" can move'),
    (lambda s: s.robot.joints[3], 'no joint "3" can move'),
    (lambda s: s.robot.drive("1"), 'linear: "1" is a string'),
    (lambda s: s.robot.teleport(0, 0, math.nan), "yaw: nan is not finite"),
    (lambda s: s.robot.scan(5), "sensor: 5 is a number; write a string"),
    (lambda s: s.robot.scan("lidat"), "name a sensor that measures scan: lidar"),
    (lambda s: s.robot.points(), "name a sensor that measures points: camera, lidar"),
    (lambda s: s.robot.scan().at("0"), 'angle: "0" is a string'),
    (lambda s: s.robot.move_to([0.1], seconds=1), "write a dict of positions by joint"),
    (lambda s: s.robot.move_to({"a": "1"}, seconds=1), 'positions.a: "1" is a string'),
    (lambda s: s.robot.move_to({"a": math.nan}, seconds=1), "positions.a: nan is not finite"),
    (lambda s: s.robot.move_to({"nope": 0.1}, seconds=1), 'no joint "nope"'),
    (lambda s: s.robot.move_to({"a": 0.1}, seconds=0), "seconds: 0 is not above 0"),
    (lambda s: s.robot.navigation.go_to("1", 0), 'x: "1" is a string'),
    (lambda s: s.robot.navigation.place((0, 0, 0)), "pose: [0, 0, 0] is a list; write a Planar"),
]


@pytest.mark.parametrize(("call", "words"), CALLS)
def test_a_method_s(sensed: Simulation, call: Callable[[Simulation], object], words: str) -> None:
    before = sensed.time, str(sensed), sensed.seed
    with pytest.raises(OneBotError) as caught:
        call(sensed)
    assert words in str(caught.value)
    assert (sensed.time, str(sensed), sensed.seed) == before


ARGUMENTS: dict[str, Any] = {
    **{"run": (1,), "keep": (1, 1), "ray": ((0, 0, 1), (1, 0, 0)), "drive": (0.1,)},
    **{"teleport": (0, 0), "move_to": ({},), "go_to": (0, 0), "place": (None,)},
}


def test_after_close_each_method_says_so() -> None:
    """What was last read remains, so that a test that failed can be reported."""
    with Simulation(sensors=True) as closed:
        robot = closed.robot
        closed.run(0.1)
        shown, pose = repr(closed), robot.pose
    for one in (closed, robot, robot.navigation):
        methods = [name for name, _ in inspect.getmembers(type(one), inspect.isfunction)]
        for name in methods:
            if not name.startswith("_") and name != "close":
                keywords = {"seconds": 1.0} if name == "move_to" else {}
                with pytest.raises(OneBotError, match="simulation has been closed"):
                    getattr(one, name)(*ARGUMENTS.get(name, ()), **keywords)
    closed.close()
    assert repr(closed) == shown and robot.pose == pose


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: load_description(None), "source: has no value; write the path of"),
        (lambda: load_description(DIFF_DRIVE, []), "arguments: [] is a list; write a dict"),
        (lambda: parse_description(None), "urdf: has no value; write a string"),
        (lambda: RobotModel.from_description("a.urdf"), 'description: "a.urdf" is a string'),
    ],
)
def test_descriptions(call: Callable[[], object], words: str) -> None:
    with pytest.raises(OneBotError) as caught:
        call()
    assert words in str(caught.value)


@pytest.mark.parametrize("given", [None, "x", 1, [1], {"nope": 1}, {"left_wheel_joint": "1"}])
@pytest.mark.parametrize("name", ["transforms", "link_poses", "link_matrices"])
def test_positions_of_a_model(name: str, given: Any) -> None:
    model = RobotModel.from_description(load_description(DIFF_DRIVE))
    with pytest.raises(OneBotError, match="joint"):
        getattr(model, name)(given)


def test_a_single_robot_s_name_is_explained() -> None:
    with Simulation(DIFF_DRIVE) as one:
        assert isinstance(one.robots[""], SimulatedRobot)
        with pytest.raises(OneBotError, match=r"simulation\.robot"):
            one.robots["robot"]
        with pytest.raises(OneBotError, match=r"Simulation\(sensors=True\)"):
            one.robot.scan()


@pytest.mark.parametrize("name", ["wheel_separation", "wheel_radius", "odometry", "command"])
def test_a_robot_that_stands_has_nothing_of_a_drive(name: str) -> None:
    with Simulation(ARM) as simulation:
        assert not simulation.robot.has_wheels
        with pytest.raises(OneBotError, match="mrm.xacro: the robot has no wheels to drive on"):
            getattr(simulation.robot, name)
        with pytest.raises(OneBotError, match="mrm.xacro: the robot has no wheels to drive on"):
            simulation.robot.drive(0.1)
        simulation.robot.set_parameters({"publish_rate": 20.0})
        with pytest.raises(OneBotError, match=r"linear\.x\.max_velocity: no such parameter"):
            simulation.robot.set_parameters({"linear.x.max_velocity": 0.3})
        simulation.run(0.1)
