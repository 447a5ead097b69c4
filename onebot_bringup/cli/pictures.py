"""Draws a robot in a given pose, or a recording, for ``onebot snapshot``, without ROS."""

import sys
from argparse import Namespace
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from onebot_bringup.cli.options import warn
from onebot_bringup.viewer.core.shown_robot import ROBOT_DESCRIPTION, RobotToShow
from onebot_bringup.viewer.display_server import open_recording
from onebot_bringup.viewer.rendering import Framing, render
from onebot_bringup.viewer.robot_messages import RobotMessages
from onebot_bringup.viewer.robot_view import RobotView
from onebot_bringup.viewer.view_source import ViewSource
from onebot_description.arrays import Floats
from onebot_description.description import Description
from onebot_description.elements.urdf import Mesh
from onebot_description.model import RobotModel

if TYPE_CHECKING:
    import rerun as rr


def draw(args: Namespace, file: Path) -> None:
    """Draw what the command line asks for; ``file`` is a path for a temporary recording."""
    if args.kind == "rrd":
        _render(args, Path(args.source))
        return
    with closing(open_recording(save=file)) as recording:
        if args.kind == "bag":
            _record_bag(args, recording.stream)
        elif args.kind == "description":
            _record_description(args, recording.stream)
        else:
            from onebot_bringup.cli.live_picture import record_running  # only this needs ROS

            for warning in record_running(args, recording.stream):
                warn(warning)
    _render(args, file)


def _render(args: Namespace, source: Path) -> None:
    framing = Framing(args.dashboard, *(args.camera or (None, None)))
    render(source, args.file, args.width, args.height, framing=framing, progress=_progress)


def _progress(message: str) -> None:
    print(message, file=sys.stderr, flush=True)


# --- a description at given joint positions -----------------------------------------------------


# Any time will do, but it is constant, so that pictures that show the time do not change.
_NOW_NS = 1_700_000_000_000_000_000


def record_pose(
    description: Description, positions: Floats, view: str, recording: "rr.RecordingStream"
) -> list[str]:
    """Log a robot at some joint positions.

    A fixed frame of the view that only a running robot has, such as odom, is replaced by the
    robot's root link.

    Args:
        description: the robot.
        positions: (M,) positions of the movable joints in the model's order, rad or m.
        view: see ``ViewSource``.
        recording: where to log.

    Returns:
        One sentence per thing that could not be drawn.
    """
    robot = RobotMessages(description)
    notices: list[str] = []
    source = ViewSource(view, notices.append)
    source.set_robot(description.robot_name)
    config = source.view
    if config.fixed_frame not in description.link_names:
        config = replace(config, fixed_frame="")
    # Plots of a single instant are empty.
    robot_view = RobotView(recording, config, robots=[RobotToShow(plotted=False)])
    messages = (*robot.standing(_NOW_NS), *robot.moving(_NOW_NS, positions))
    for topic, kind, data in messages:
        robot_view.take(topic, kind, data, _NOW_NS)
    return notices + robot_view.tick(_NOW_NS) + robot_view.finish()


def _record_description(args: Namespace, recording: "rr.RecordingStream") -> None:
    description = args.description
    lacking = _mesh_problems(description)  # the view warns about them
    for text in description.notices:
        if not text.endswith(lacking):
            warn(text)
    positions = RobotModel.from_description(description).pose(args.joints)
    warnings = record_pose(description, positions, args.view, recording)
    for text in warnings:
        # Problems of the text itself were already reported with the lines of its file.
        if not text.startswith(f"{ROBOT_DESCRIPTION}:"):
            warn(text)


def _mesh_problems(description: Description) -> tuple[str, ...]:
    parts = (part for link in description.links for part in (*link.visuals, *link.collisions))
    meshes = [part.shape for part in parts if isinstance(part.shape, Mesh)]
    return tuple(mesh.problem for mesh in meshes if mesh.problem)


# --- a bag --------------------------------------------------------------------------------------


def _record_bag(args: Namespace, recording: "rr.RecordingStream") -> None:
    from onebot_bringup.bags.bag_reader import Bag
    from onebot_bringup.bags.shown_bag import ShownBag

    bag = ShownBag(
        Bag(Path(args.source)),
        view=args.view,
        namespace=args.namespace,
        progress=_progress,
        warn=warn,
    )
    bag.log(recording, from_start=False)
