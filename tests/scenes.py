"""Scenes whose results are bit-identical on each system, Python and build of PyBullet.

``python tests/scenes.py`` prints a line for each: its name, and a digest of all that is observed.
"""

import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

from onebot_control import RobotSetup, Simulation

ROBOTS = Path(__file__).parent / "robots"
NOTEBOOKS = "package://onebot_bringup/notebooks"


def observed(simulation: Simulation) -> bytes:
    """Where everything is, to the last bit."""
    robots = simulation.robots.values()
    values = [
        [each.pose, [*each.twist], each.odometry if each.has_wheels else None, each.joints]
        for each in robots
    ]
    return repr([simulation.time, values, dict(simulation.boxes)]).encode()


def maze() -> list[bytes]:
    """OneBot with its sensors drives to a wall, and pushes against it."""
    with Simulation(world="maze", y=0.8, sensors=True, seed=7) as simulation:
        robot, found = simulation.robot, []
        for linear, angular, seconds in ((0.5, 0.0, 3.0), (0.4, 0.8, 1.5), (1.0, 0.0, 3.0)):
            robot.drive(linear, angular)
            simulation.run(seconds)
            arrays = robot.scan().ranges, robot.image(), robot.depth(), robot.points("camera")
            found += [observed(simulation), *(array.tobytes() for array in arrays)]
            found.append(repr(robot.imu()).encode())
    return found


def ramp() -> list[bytes]:
    """OneBot drives up a ramp."""
    with Simulation(world="ramp") as simulation:
        simulation.robot.drive(0.5)
        simulation.run(6.0)
        return [observed(simulation)]


def fleet() -> list[bytes]:
    """Robots of three makers drive in circles."""
    models = (None, ROBOTS / "good_leo_rover.xacro", ROBOTS / "good_tracer.xacro")
    setups = {f"robot{row}": RobotSetup(y=3.0 * row, model=each) for row, each in enumerate(models)}
    with Simulation(robots=setups) as simulation:
        for robot in simulation.robots.values():
            robot.drive(0.3, 0.4)
        simulation.run(3.0)
        return [observed(simulation)]


def arm() -> list[bytes]:
    """A Panda moves three of its joints."""
    with Simulation(ROBOTS / "arms/panda.urdf") as simulation:
        goal = {"fer_joint1": 0.5, "fer_joint4": -1.5, "fer_joint6": 1.0}
        simulation.robot.move_to(goal, seconds=2.0)
        simulation.run(3.0)
        return [observed(simulation)]


def grasp() -> list[bytes]:
    """OneBot's gripper lifts a box."""
    files = f"{NOTEBOOKS}/gripper.urdf.xacro", f"{NOTEBOOKS}/table.urdf.xacro"
    with Simulation(files[0], world=files[1]) as simulation:
        robot, found = simulation.robot, []
        for goal in ({"lift": 0.1, "finger": 0.04}, {"lift": 0.0}, {"finger": 0.0}, {"lift": 0.1}):
            if goal == {"lift": 0.0}:
                robot.drive(0.2)
                simulation.run(2.0)
                robot.drive(0.0)
                simulation.run(1.0)
            robot.move_to(goal, seconds=1.0)
            simulation.run(1.5)
            found.append(observed(simulation))
    return found


SCENES: tuple[Callable[[], list[bytes]], ...] = (maze, ramp, fleet, arm, grasp)


def digests() -> dict[str, str]:
    """Run all scenes; return a digest of each, by its name."""

    def digest(parts: list[Any]) -> str:
        return hashlib.sha256(b"\0".join(parts)).hexdigest()[:16]

    return {scene.__name__: digest(scene()) for scene in SCENES}


if __name__ == "__main__":
    for name, digest in digests().items():
        print(name, digest)
