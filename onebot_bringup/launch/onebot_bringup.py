#!/usr/bin/env python3
"""Brings OneBot up: simulated, driven by its controller and shown in the viewer."""

import sys
from collections.abc import Sequence

from onebot_bringup.launch.program import run_bringup

TYPE_CHECKING = False  # typing's constant; typing is slow to import
if TYPE_CHECKING:
    from onebot_bringup.launch.bringup import Bringup


def command() -> "Bringup":
    """Return the bringup command with OneBot's defaults."""
    from onebot_bringup.launch.bringup import Bringup
    from onebot_description.elements.packages import package_share

    description = package_share("onebot_description").resolve()  # files are edited there
    return Bringup(
        program="onebot_bringup",
        summary="Brings OneBot up on ROS 2, simulated; a Twist on velocity_controller/cmd_vel "
        "drives it.",
        model=str(description / "urdf/onebot.urdf.xacro"),
        joints=str(description / "config/joints.yaml"),
        view=str(description / "config/view.yaml"),
        world_view=str(description / "config/world_view.yaml"),
        control=str(package_share("onebot_control") / "config/control.yaml"),
    )


def main(argv: Sequence[str] | None = None) -> int:
    """Bring OneBot up until Ctrl-C; ``onebot_bringup --help`` lists the arguments."""
    return run_bringup(command, "onebot_bringup", argv)


if __name__ == "__main__":
    sys.exit(main())
