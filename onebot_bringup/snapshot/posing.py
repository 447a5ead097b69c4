"""A robot as its description has it, at given joint positions, for a picture without ROS."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from onebot_bringup.viewer.live_view import LiveView
from onebot_bringup.viewer.recording import open_recording
from onebot_bringup.viewer.view_config import ViewConfig
from onebot_description.description import Description
from onebot_description.errors import OneBotError
from onebot_description.joints.limits import zero_position
from onebot_description.model import RobotModel
from onebot_description.model.robot_model import JointArrays
from onebot_description.tf.wire import TfArrays

Floats = NDArray[np.float64]

# Any moment will do, but always the same: a picture with a clock in it stays the same, too.
_NOW_NS = 1_700_000_000_000_000_000
_SLACK = 1e-9  # rad or m beyond a limit: rounding


def pose_of(model: RobotModel, description: Description, given: Mapping[str, float]) -> Floats:
    """Return the positions of all moving joints, (M,) in the model's order, rad or m.

    A joint that is not given stands at 0, or in the middle of its range if 0 is not in it; mimic
    joints follow.

    Args:
        model: the robot's.
        description: the same robot's.
        given: positions by joint, rad or m.

    Raises:
        OneBotError: no such joint moves, it follows another one, or a limit is exceeded.
    """
    mimics = {joint.name: joint.mimic for joint in description.joints if joint.mimic is not None}
    for name in given:
        model.row(name)
        if name in mimics:
            leader = mimics[name].joint
            raise OneBotError(f'joint "{name}" follows joint "{leader}": give the position of that')
    rests = {
        name: zero_position(model.lower[row], model.upper[row])
        for row, name in enumerate(model.joints)
        if name not in mimics
    }
    positions = model.positions({**rests, **given})
    problems = [_beyond(model, row, positions[row]) for row in range(len(positions))]
    if any(problems):
        raise OneBotError("\n".join(filter(None, problems)))
    return positions


def _beyond(model: RobotModel, row: int, position: float) -> str:
    lower, upper = model.lower[row], model.upper[row]
    if lower - _SLACK <= position <= upper + _SLACK:
        return ""
    return f'joint "{model.joints[row]}": {position:g} is out of its limits, {lower:g} to {upper:g}'


def record_pose(
    description: Description,
    positions: Floats,
    view: ViewConfig,
    blueprint: Path | None,
    rrd: Path,
) -> list[str]:
    """Record the robot at ``positions`` into the file ``rrd``.

    Args:
        description: the robot.
        positions: (M,) of the moving joints in the model's order, rad or m.
        view: how to look at it. A fixed frame that only a running robot has, such as odom, gives
            way to the robot's root link.
        blueprint: a ``.rbl`` file whose layout takes the place of the view's.
        rrd: the recording to write.

    Returns:
        What could not be drawn, a sentence each.
    """
    model = RobotModel.from_description(description)
    if view.fixed_frame not in description.links:
        view = replace(view, fixed_frame="")
    recording = open_recording(save=rrd)
    try:
        live = LiveView(recording.stream, view, blueprint=blueprint)
        problems = live.set_description(description.urdf)
        live.add_transforms(_transforms(model.fixed, model.fixed.constant), static=True)
        live.add_transforms(_transforms(model.moving, model.moving.transforms(positions)))
        live.add_joints(_NOW_NS, model.joints, positions, np.zeros(0))
        problems += live.tick(_NOW_NS)
        live.finish(_NOW_NS)
    finally:
        recording.close()
    return problems


def _transforms(joints: JointArrays, values: Floats) -> TfArrays:
    stamps = np.full(len(values), _NOW_NS)
    return TfArrays(
        list(joints.parents), list(joints.children), stamps, values[:, :3], values[:, 3:]
    )
