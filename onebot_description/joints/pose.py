"""A robot's joint positions as a user gives them: some by name, the others at rest."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from onebot_description.description import Description
from onebot_description.errors import OneBotError
from onebot_description.joints.motion_limits import zero_position
from onebot_description.model import RobotModel

Floats = NDArray[np.float64]

_SLACK = 1e-9  # rad or m beyond a limit: rounding


def pose_of(model: RobotModel, description: Description, given: Mapping[str, float]) -> Floats:
    """Return the positions of all moving joints, (M,) in the model's order, rad or m.

    A joint that is not in ``given`` is at 0, or in the middle of its range if 0 is not in it; mimic
    joints follow. Raises OneBotError for a joint that does not move, follows another one, or would
    exceed a limit.
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
    # A follower may be beyond its limits while its leader rests: nobody has asked for that.
    chosen = np.flatnonzero(positions != model.positions(rests))
    problems = [_beyond(model, row, positions[row]) for row in chosen.tolist()]
    if any(problems):
        raise OneBotError("\n".join(filter(None, problems)))
    return positions


def _beyond(model: RobotModel, row: int, position: float) -> str:
    lower, upper = model.lower[row], model.upper[row]
    if lower - _SLACK <= position <= upper + _SLACK:
        return ""
    return f'joint "{model.joints[row]}": {position:g} is out of its limits, {lower:g} to {upper:g}'
