#!/usr/bin/env python3
"""Brings MRM up: its joint moves as config/joints.yaml describes, and the viewer shows it."""

import sys
from collections.abc import Sequence

from onebot_bringup.launch.program import run_bringup

TYPE_CHECKING = False  # typing is slow to import
if TYPE_CHECKING:
    from onebot_bringup.launch.bringup import Bringup


def command() -> "Bringup":
    """Return the command: what it brings up, and its defaults."""
    from onebot_bringup.launch.bringup import Bringup
    from onebot_description.elements.packages import package_share

    share = package_share("mrm_description").resolve()  # the folder that users edit
    return Bringup(
        program="mrm_bringup",
        summary="Brings MRM up on ROS 2, moving, and shows it; sim:=true simulates it.",
        model=str(share / "urdf/mrm.xacro"),
        joints=str(share / "config/joints.yaml"),
        view=str(share / "config/view.yaml"),
        sim_view=str(share / "config/sim_view.yaml"),
    )


def main(argv: Sequence[str] | None = None) -> int:
    """Bring MRM up until Ctrl-C; ``mrm_bringup --help`` lists the arguments."""
    return run_bringup(command, "mrm_bringup", argv)


if __name__ == "__main__":
    sys.exit(main())
