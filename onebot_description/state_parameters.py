"""The parameters of robot_state_publisher; some are also launch arguments."""

from dataclasses import dataclass

from onebot_description.parameters.reader import parameter


@dataclass(frozen=True)
class StateParameters:
    """The parameters of robot_state_publisher; README.md has a table of them."""

    robot_description: str = parameter("", "the URDF; required without FILE")
    publish_frequency: float = parameter(
        0.0,
        "maximum rate of each transform, Hz; 0: every message",
        at_least=0.0,
        at_most=1e3,
    )
    ignore_timestamp: bool = parameter(False, "publish joint states whatever their stamp is")
    frame_prefix: str = parameter("", "prepended to every frame as it is")
    hold_floating_joints: bool = parameter(
        False, "publish floating joints at their origin, for a robot that no other node places"
    )
