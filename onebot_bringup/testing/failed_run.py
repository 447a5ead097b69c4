"""Shows the end of a failed test's simulation: a recording for Rerun, and a picture of it."""

from collections.abc import Mapping, Sequence
from contextlib import closing, suppress
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from onebot_bringup.viewer.blueprint import fitting_eye
from onebot_bringup.viewer.core.robot_shapes import box_around, diagonal, robot_bounds
from onebot_bringup.viewer.core.shown_robot import WORLD_DESCRIPTION, RobotToShow
from onebot_bringup.viewer.display_server import open_recording
from onebot_bringup.viewer.rendering import render
from onebot_bringup.viewer.robot_messages import (
    Published,
    RobotMessages,
    published_description,
    published_transforms,
)
from onebot_bringup.viewer.robot_view import RobotView
from onebot_bringup.viewer.view_config import CameraSettings, ViewConfig
from onebot_control.conventions import WORLD_FRAME
from onebot_control.physics.scene import scene_frames
from onebot_control.simulation import Simulation
from onebot_control.simulation_core import Moment
from onebot_description.errors import OneBotError
from onebot_description.geometry import matrices
from onebot_description.geometry.poses import Transform

if TYPE_CHECKING:
    import rerun as rr

_SIDES = 4  # the robots are seen from one of them


def show_failed_run(simulation: Simulation, base: Path) -> list[Path]:
    """Write the recorded end of a simulation to files.

    Args:
        simulation: the simulation, whose ``record`` was called.
        base: the path of the files without a suffix; existing files are replaced.

    Returns:
        The files: .rrd, and .png if it can be drawn.

    Raises:
        OneBotError: it cannot be recorded.
    """
    recorded, picture = (base.with_name(f"{base.name}{ending}") for ending in (".rrd", ".png"))
    base.parent.mkdir(parents=True, exist_ok=True)
    record_run(simulation, recorded)
    with suppress(OneBotError):
        render(recorded, picture, progress=lambda _: None)
        return [recorded, picture]
    return [recorded]


def record_run(simulation: Simulation, path: Path) -> None:
    """Write the recorded end of a simulation, which may be closed, to a .rrd file.

    Raises:
        OneBotError: it cannot be recorded.
    """
    with closing(open_recording(save=path)) as recording:
        _record(simulation, recording.stream)


def _record(simulation: Simulation, stream: "rr.RecordingStream") -> None:
    robots = [RobotMessages(robot.description, name) for name, robot in simulation.robots.items()]
    names = [
        RobotToShow(f"/{name}" if name else "", f"{name}/" if name else "", plotted=not name)
        for name in simulation.robots
    ]
    world, moments = simulation.world, simulation.moments
    camera = _camera(simulation, robots, moments[-1]) if moments else CameraSettings()
    config = ViewConfig(fixed_frame=WORLD_FRAME, camera=camera)
    view = RobotView(stream, config, robots=names, from_start=True)
    messages: list[Published] = []
    if moments:
        start = moments[0].stamp
        messages += (message for robot in robots for message in robot.standing(start))
        if world is not None:
            frames = scene_frames(world, WORLD_FRAME)
            messages.append(published_description(WORLD_DESCRIPTION, world.urdf))
            messages.append(published_transforms("/tf_static", start, *frames))
    for moment in moments:
        for robot, pose, joints in zip(robots, moment.poses, moment.joints, strict=True):
            messages.append(_in_world(moment.stamp, {robot.root: pose}))
            messages += robot.moving(moment.stamp, robot.model.positions(joints))
        if moment.boxes:
            messages.append(_in_world(moment.stamp, moment.boxes))
        for topic, kind, data in messages:
            view.take(topic, kind, data, moment.stamp)
        messages.clear()
        view.tick(moment.stamp)
    view.finish()


def _camera(simulation: Simulation, robots: Sequence[RobotMessages], end: Moment) -> CameraSettings:
    """Return a camera that shows all robots where they are at the end, from an open side."""
    boxes = []
    for robot, shown_robot, pose, joints in zip(
        simulation.robots.values(), robots, end.poses, end.joints, strict=True
    ):
        root = matrices.of_transform(pose)
        links = shown_robot.model.link_matrices(shown_robot.model.positions(joints))
        poses = {link: root @ matrix for link, matrix in links.items()}
        boxes.append(robot_bounds(robot.description, poses))
    bounds = [box for box in boxes if box is not None]
    if not bounds:
        return CameraSettings()
    box = box_around(np.concatenate(bounds))
    with suppress(OneBotError):  # a closed simulation has no rays
        for eye, target in map(partial(fitting_eye, box), range(_SIDES)):
            away = np.subtract(target, eye)
            if simulation.ray(eye, away.tolist()) > np.linalg.norm(away) - diagonal(box) / 2.0:
                return CameraSettings(eye, target)
    return CameraSettings(*fitting_eye(box))


def _in_world(stamp_ns: int, poses: Mapping[str, Transform]) -> Published:
    """Return the transforms of frames at these poses in the world."""
    values = np.array([np.hstack(pose) for pose in poses.values()])
    return published_transforms("/tf", stamp_ns, [WORLD_FRAME] * len(poses), [*poses], values)
