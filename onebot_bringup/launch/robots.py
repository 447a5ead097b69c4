"""Reads ``robots:=N`` and ``robots:=FILE.yaml``: the robots' names, places and models.

The file names each robot and where it starts. Its model and further parameters of its controller
are files, relative to this one::

    robots:
      scout: {x: 0.0, y: 0.0, yaw: 0.0}
      carrier: {x: 1.5, y: 0.0, model: carrier.urdf.xacro, params_file: carrier.yaml}
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from onebot_bringup.launch.arguments import require_file
from onebot_description.errors import OneBotError
from onebot_description.parameters.reader import REQUIRED, Problem, parameter, read
from onebot_description.parameters.values import NAMESPACE, NAMESPACE_WANTED

if TYPE_CHECKING:
    from onebot_description.description import Description

_ROOM = 1.8  # distance between robots in rows, in diameters of a robot


class PlacedRobot(NamedTuple):
    """One of several robots in one world."""

    name: str  # its namespace, below the bringup's
    x: float  # m, where it starts
    y: float  # m
    yaw: float  # rad
    description: Description
    params_file: Path | None = None  # parameters of its controller; override the fleet's


@dataclass(frozen=True)
class RobotEntry:
    """The entry of a robot in the file."""

    x: float = parameter(REQUIRED, "where it starts in the world, m")
    y: float = parameter(REQUIRED, "where it starts in the world, m")
    yaw: float = parameter(0.0, "where it faces at the start, rad")
    model: str = parameter("", "a URDF or xacro file; empty: model:=")
    params_file: str = parameter("", "further parameters of its controller, a YAML file")


@dataclass(frozen=True)
class RobotsFile:
    """The content of the file."""

    robots: Mapping[str, RobotEntry] = parameter(REQUIRED, "a map of names, each with x and y")

    def check(self) -> Iterator[Problem]:
        """Report names that are not valid namespaces."""
        if not self.robots:
            yield Problem("robots", "is empty; write a robot, such as scout: {x: 0.0, y: 0.0}")
        for name in self.robots:
            if not NAMESPACE.fullmatch(name):
                text = f"is not valid as a namespace; write {NAMESPACE_WANTED}"
                yield Problem(f"robots.{name}", text)


def placed_robots(text: str, description: Description) -> list[PlacedRobot]:
    """Return the robots of ``robots:=text``.

    Args:
        text: the number of robots, or a YAML file.
        description: used for robots without a model of their own.

    Raises:
        OneBotError: ``text`` is neither, or the file, or a robot's model or parameters, is invalid.
    """
    if text.isdecimal() and int(text) > 0:
        return in_rows(int(text), description)
    return read_robots(Path(text), description)


def read_robots(file: Path, description: Description) -> list[PlacedRobot]:
    """Return the robots of a file.

    Raises:
        OneBotError: the file, or a robot's model or parameters, is invalid; names the line.
    """
    from onebot_description.parameters.files import read_map, read_text

    require_file("robots", file, "; write how many, or a YAML file")
    written = read_map(read_text(file), str(file))
    entries = read(RobotsFile, written.values, written.places).robots
    models: dict[str, Description] = {"": description}
    robots = []
    for name, entry in entries.items():
        try:
            if entry.model not in models:
                models[entry.model] = _model(file, entry.model)
            params_file = _params_file(file, entry.params_file)
        except OneBotError as error:
            problem = Problem(f"robots.{name}", str(error))
            raise OneBotError(problem.message(written.places)) from None
        place = entry.x, entry.y, entry.yaw
        robot = PlacedRobot(name, *place, description=models[entry.model], params_file=params_file)
        robots.append(robot)
    return robots


def _model(file: Path, model: str) -> Description:
    from onebot_description.description import load_description

    path = model if "://" in model else str(file.parent / Path(model).expanduser())
    description = load_description(path)
    description.require_tree()
    return description


def _params_file(file: Path, name: str) -> Path | None:
    path = (file.parent / Path(name).expanduser()).absolute()
    if name and not path.is_file():
        raise OneBotError(f"params_file: {path}: no such file")
    return path if name else None


def in_rows(count: int, description: Description) -> list[PlacedRobot]:
    """Place ``count`` robots in rows, with space between them.

    robot1 is at the origin, the others of its row are to its right, further rows behind it.
    """
    per_row = math.ceil(math.sqrt(count))
    gap = math.ceil(10.0 * _ROOM * 2.0 * reach(description)) / 10.0
    return [
        PlacedRobot(f"robot{k + 1}", -gap * (k // per_row), -gap * (k % per_row), 0.0, description)
        for k in range(count)
    ]


def reach(description: Description) -> float:
    """Return the largest horizontal distance of a robot's parts from its root link's origin, m."""
    from onebot_control.sensing.solids import robot_solid  # slow to import

    corners = robot_solid(description).corners
    return float(np.hypot(corners[:, 0], corners[:, 1]).max(initial=0.0))
