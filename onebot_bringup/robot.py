"""Which robot a bringup command brings up."""

from typing import NamedTuple


class Robot(NamedTuple):
    """What a bringup command brings up unless its arguments say otherwise.

    Attributes:
        program: the command's name.
        summary: what it does, for ``--help``.
        model: its URDF or xacro file.
        joints: parameters of joint_state_publisher; empty: every joint swings within its limits.
        view: the viewer's settings; empty: the viewer's own.
        control: parameters of the controller of a robot that can be simulated; empty: of none.
        takes_file: the model is the command's first word instead.
    """

    program: str
    summary: str
    model: str = ""
    joints: str = ""
    view: str = ""
    control: str = ""
    takes_file: bool = False
