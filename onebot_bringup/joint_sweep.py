"""A motion for a robot that nobody wrote one for: every joint swings slowly within its limits."""

import math

from onebot_description.description import Description, JointSpec

RATE = 30.0
"""Hz, at which the joint states are published."""
PERIOD = 8.0
"""Seconds for one swing, unless the joint's speed limit asks for more."""
_SHARE_OF_RANGE = 0.9
_SHARE_OF_SPEED = 0.5
_FREE_SWING = math.pi / 2  # rad; a continuous joint has no limits
_MOVABLE = ("revolute", "continuous", "prismatic")


def sweep_parameters(description: Description) -> dict[str, object]:
    """Return parameters of joint_state_publisher that move each joint; mimic joints follow.

    Each joint swings as ``offset + amplitude * sin(2 pi frequency t + phase)``, in rad or m. Its
    highest speed, ``2 pi frequency amplitude``, is at most half of the joint's speed limit. The
    phases are spread over the turn, so that the robot does not move as one piece.
    """
    joints = [joint for joint in description.joints if _movable(joint)]
    motions = {joint.name: _swing(joint, i / len(joints)) for i, joint in enumerate(joints)}
    return {"rate": RATE, **({"motions": motions} if motions else {})}


def _movable(joint: JointSpec) -> bool:
    return joint.kind in _MOVABLE and joint.mimic is None


def _swing(joint: JointSpec, turn: float) -> dict[str, object]:
    middle, amplitude = _range(joint)
    frequency = 1.0 / PERIOD
    if joint.velocity and amplitude > 0.0:
        frequency = min(frequency, _SHARE_OF_SPEED * joint.velocity / (math.tau * amplitude))
    return {
        "type": "sine",
        "offset": middle,
        "amplitude": amplitude,
        "frequency": frequency,
        "phase": math.tau * turn,
    }


def _range(joint: JointSpec) -> tuple[float, float]:
    """Return middle and amplitude of the swing, in rad or m."""
    if joint.lower is None or joint.upper is None:
        return 0.0, _FREE_SWING if joint.kind == "continuous" else 0.0
    if joint.kind == "continuous":
        return 0.0, _FREE_SWING
    half = (joint.upper - joint.lower) / 2
    return joint.lower + half, _SHARE_OF_RANGE * half
