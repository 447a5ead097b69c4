"""Brings up a robot's description: joint states, transforms and the viewer, a process each."""

from collections.abc import Sequence

from onebot_bringup.launcher.standby import Standby
from onebot_bringup.robot import Robot

__all__ = ["Robot", "bring_up"]

_QUESTIONS = {"-h", "--help", "-s", "--show-args"}


def bring_up(robot: Robot, argv: Sequence[str]) -> int:
    """Bring ``robot`` up, with the launch arguments in ``argv``, until Ctrl-C.

    No node is started before the description and all arguments have been found right.

    Returns:
        The exit code: 0 when stopped by the user, 1 when a node that matters has failed.

    Raises:
        UsageError: the command line is wrong.
        OneBotError: a file is.
    """
    with Standby(_probable_modules(robot, argv)) as standby:
        # Only now: while this is imported, the interpreters start as well.
        from onebot_bringup.bringup_start import start

        return start(robot, argv, standby)


def _probable_modules(robot: Robot, argv: Sequence[str]) -> list[str]:
    """Return the modules that will be needed, if nothing is wrong; the most urgent first."""
    if not _QUESTIONS.isdisjoint(argv):
        return []
    modules = ["onebot_description.robot_state_publisher"]
    if robot.control and "sim:=false" not in argv:
        modules.insert(0, "onebot_control.velocity_controller")
    elif "joint_states:=false" not in argv:
        modules.append("onebot_description.joint_state_publisher")
    if "viewer:=none" not in argv:
        modules.append("onebot_bringup.rerun_viewer")
    if any(word.startswith("record:=") for word in argv):
        modules.insert(0, "onebot_bringup.bag_recorder")  # it is to miss nothing
    return modules
