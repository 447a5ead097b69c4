"""How a robot finds its way in a maze in which ten boxes move across its path.

    python -m tests.benchmarks.moving_boxes [--goals N] [--seed N]

drives OneBot to random free cells of the maze, and prints each run. Each box moves to and fro on a
diagonal of its cell, and waits at both ends. It turns back before the robot, so that a contact of a
robot that moves is the navigator's fault.
"""

import argparse
import math
import re
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from onebot_control import SimulatedRobot, Simulation
from onebot_control.navigation.grid import placed
from onebot_description.description.loading import shipped_worlds
from onebot_description.geometry.poses import PlanarPose

_CELL, _CELLS, _COUNT, _EDGE = 0.8, 4, 10, 0.2  # m, number, number, m
_SWING, _WAIT, _SPEED = 0.25, 4.0, 0.12  # m along x and y, s, m/s
_EVERY, _MARGIN = 0.05, 0.08  # s between two positions; m between a box and the robot
_OFF_CENTER = 0.04  # m between a goal and the center of its cell
_LIMIT = 400.0  # s
_PARAMETERS = {"linear.x.max_velocity": 0.5}


class _Box:
    """A box that moves."""

    def __init__(self, cell: tuple[int, int], generator: np.random.Generator) -> None:
        self.center = _CELL * np.array(cell)
        self._diagonal = np.array([1.0, generator.choice([-1.0, 1.0])])
        self._move = 2.0 * _SWING * math.sqrt(2.0) / _SPEED  # s from one end to the other
        self._phase, self._step = generator.uniform(0.0, 2.0 * (self._move + _WAIT)), _EVERY

    def position(self, phase: float | None = None) -> Any:
        """Return where it is, (2,), m, or where it will be in another phase."""
        phase = (self._phase if phase is None else phase) % (2.0 * (self._move + _WAIT))
        there = np.clip(phase / self._move, 0.0, 1.0)
        back = np.clip((phase - self._move - _WAIT) / self._move, 0.0, 1.0)
        return self.center + _SWING * (2.0 * (there - back) - 1.0) * self._diagonal

    def advance(self, rim: Any) -> None:
        """Move on, or turn back before the robot with a rim of points (N, 2), m."""
        ahead = self._phase + self._step
        away, now = (_away(rim, self.position(phase)) for phase in (ahead, self._phase))
        if away > _MARGIN or away > now:
            self._phase = ahead
        else:
            self._step *= -1.0


def _away(points: Any, center: Any) -> float:
    """Return the distance between points, (N, 2), and a box."""
    beyond = np.maximum(np.abs(points - center) - _EDGE / 2.0, 0.0)
    return float(np.hypot(*beyond.T).min())


def _world(boxes: list[_Box], folder: Path) -> Path:
    """Write the maze with these boxes in place of its own."""
    maze = shipped_worlds()["maze"]
    text = re.sub("<xacro:crate .*?/>", "", maze.read_text())
    text = text.replace('"parts.xacro"', f'"{maze.with_name("parts.xacro")}"')
    crates = "".join(
        f'<xacro:crate name="box{number}" x="{x}" y="{y}" edge="{_EDGE}" mass="5.0"/>'
        for number, (x, y) in enumerate(box.position() for box in boxes)
    )
    file = folder / "boxes.urdf.xacro"
    file.write_text(text.replace("</robot>", f"{crates}</robot>"))
    return file


def _rim(robot: SimulatedRobot) -> Any:
    """Return points on the rim of the robot's footprint, (N, 2), in the world, m."""
    corners, share = robot.navigation.navigator.vehicle.footprint, np.linspace(0.0, 1.0, 10)
    rim = (corners + share[:, None, None] * (np.roll(corners, -1, axis=0) - corners)).reshape(-1, 2)
    pose = robot.pose
    return placed(rim, PlanarPose(pose.x, pose.y, pose.yaw))


def drive(goals: int, seed: int) -> list[tuple[bool, int]]:
    """Drive to goals; return whether each was reached, and the cycles with a contact until then.

    Only contacts of a robot that moves count.
    """
    generator = np.random.default_rng(seed)
    cells = [(x, y) for x in range(_CELLS) for y in range(_CELLS) if (x, y) != (0, 0)]
    chosen = [cells[index] for index in generator.permutation(len(cells))]
    boxes = [_Box(cell, generator) for cell in chosen[:_COUNT]]
    free = _CELL * np.array([(0, 0), *chosen[_COUNT:]])
    outcomes: list[tuple[bool, int]] = []
    with (
        tempfile.TemporaryDirectory() as folder,
        Simulation(
            world=_world(boxes, Path(folder)), sensors=True, parameters=_PARAMETERS
        ) as world,
    ):
        robot, scene = world.robot, world._core.fleet.world.scene
        assert scene is not None
        cycles, touched = 0, 0

        def move() -> None:
            nonlocal cycles, touched
            cycles += 1
            moves = abs(robot.twist.linear) > 0.02 or abs(robot.twist.angular) > 0.05
            touched += moves and any(contact.other != "ground" for contact in robot.contacts)
            if cycles % round(_EVERY / world.period) == 0:
                rim = _rim(robot)
                for box in boxes:
                    box.advance(rim)
                places = [(*box.position().tolist(), _EDGE / 2.0) for box in boxes]
                scene.put([(place, (0.0, 0.0, 0.0, 1.0)) for place in places])

        world.on_step(move)
        while len(outcomes) < goals:
            x, y = generator.choice(free) + generator.uniform(-_OFF_CENTER, _OFF_CENTER, 2)
            if math.hypot(x - robot.pose.x, y - robot.pose.y) < _CELL / 2.0:
                continue
            began, touched = world.time, 0
            robot.go_to(x, y, generator.uniform(-math.pi, math.pi))
            world.run(until=lambda: not robot.navigating, timeout=_LIMIT)
            outcomes.append((robot.navigation.status == "arrived", touched))
            navigator = robot.navigation.navigator
            off = math.hypot(navigator.pose.x - robot.pose.x, navigator.pose.y - robot.pose.y)
            status = f"{navigator.status} {navigator.reason}".strip()
            seconds = f"{world.time - began:.1f} s, {navigator.recoveries} recoveries"
            print(f"{x:.2f} {y:.2f}: {status}, {seconds}, {touched} touched, {off:.3f} m off")
    return outcomes


def main(argv: list[str]) -> int:
    """Drive to goals, print a summary, and return 0."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks.moving_boxes")
    parser.add_argument("--goals", type=int, default=20, metavar="N")
    parser.add_argument("--seed", type=int, default=0, metavar="N", help="of boxes and goals")
    arguments = parser.parse_args(argv)
    outcomes = drive(arguments.goals, arguments.seed)
    reached, touched = (sum(map(bool, column)) for column in zip(*outcomes, strict=True))
    print(f"{len(outcomes)} goals: {reached} reached, {touched} with a contact while it moved")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
