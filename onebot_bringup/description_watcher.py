"""description_watcher: edits of a robot's files take effect while it runs.

Run as ``python -m onebot_bringup.description_watcher [--known JSON] FILE [name:=value ...]
--ros-args ...``; FILE is a URDF or xacro file, the rest are xacro's arguments. JSON says as what
the files are known already (see ``description_files.Known``).

Calls:
    robot_state_publisher/set_parameters (rcl_interfaces/srv/SetParameters): robot_description.

A file that cannot be used is reported and changes nothing: the last good description stays. Files
that are known are only looked at until one is edited: ROS, and the memory it takes, comes then.
"""

import signal
import sys
from collections.abc import Sequence

from onebot_bringup.description_files import Known


def main(args: Sequence[str] | None = None) -> int:
    """Run the node until it is told to stop."""
    arguments = list(sys.argv if args is None else args)
    known = None
    if arguments[1:2] == ["--known"]:
        known = Known.from_json(arguments[2])
        del arguments[1:3]
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.default_int_handler)
    try:
        if known is not None:
            known.wait_for_edit()
        return _run(arguments, known.digest if known is not None else "")
    except KeyboardInterrupt:
        return 0


def _run(arguments: list[str], digest: str) -> int:
    """Load the file whenever it is edited; ``digest`` is that of the URDF in force."""
    from onebot_bringup.launcher.arguments import split
    from onebot_description.errors import OneBotError
    from onebot_description.ros_arguments import ros_arguments

    try:
        parts = split(ros_arguments(arguments).others)
        if len(parts.positional) != 1:
            raise OneBotError("write the one file to watch, a URDF or xacro file")
    except OneBotError as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    from onebot_bringup.description_update import DescriptionUpdate
    from onebot_description.ros import run_node

    # To rcl, name:=value outside of --ros-args is a remapping in its old form: keep it from that.
    start = arguments.index("--ros-args") if "--ros-args" in arguments else len(arguments)
    model, of_xacro = parts.positional[0], dict(parts.given)
    return run_node(
        lambda: DescriptionUpdate(model, of_xacro, digest), [*arguments[:1], *arguments[start:]]
    )


if __name__ == "__main__":
    sys.exit(main())
