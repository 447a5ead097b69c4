"""``onebot view``: brings up any robot from its file."""

from collections.abc import Sequence

from onebot_bringup.launch.bringup import Bringup, bring_up


def run(argv: Sequence[str]) -> int:
    """Run the command and return its exit code."""
    command = Bringup(
        program="onebot view",
        summary="Brings up any robot from its URDF or xacro file, with its joints moving.",
        takes_file=True,
    )
    return bring_up(command, argv)
