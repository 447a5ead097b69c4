"""What a bringup command tells its user."""

from collections.abc import Mapping, Sequence

from onebot_bringup.launcher.arguments import Argument, table
from onebot_bringup.robot import Robot
from onebot_description.description import Description


def help_text(
    robot: Robot, declared: list[Argument], of_model: Sequence[Argument], *, complete: bool
) -> str:
    """Return the answer to ``--show-args``, or (``complete``) to ``--help``."""
    parts = []
    if complete:
        file = " FILE" if robot.takes_file else ""
        parts.append(f"usage: {robot.program}{file} [name:=value ...] [--ros-args ...]")
        parts.append(robot.summary)
    parts.append(f"Arguments and their defaults:\n{table(declared)}")
    if of_model:
        parts.append(f"Arguments of the model:\n{table(of_model)}")
    if complete:
        parts.append(
            "An argument given twice: the last one counts. --ros-args goes to every node.\n"
            "Ctrl-C stops everything. Exit codes: 0 stopped by the user, 1 a file is wrong or a\n"
            "node failed, 2 the command line is wrong."
        )
    return "\n\n".join(parts)


def summary_text(description: Description, values: Mapping[str, str]) -> str:
    """Return what is running, where to look for it and how to stop it."""
    moving = [joint for joint in description.joints if joint.kind != "fixed"]
    space = f"/{values['namespace'].strip('/')}".rstrip("/")
    lines = [
        f'Robot "{description.robot_name}": {len(description.links)} links, '
        f"{len(moving)} of {len(description.joints)} joints can move",
        f"  model    {values['model']}",
        f"  topics   /tf /tf_static {space}/robot_description {space}/joint_states",
    ]
    if values.get("sim") == "true":
        drive = f"{space}/velocity_controller/cmd_vel"
        lines.append(
            f"  drive    onebot teleop{f' {drive}' if space else ''}, or a Twist on {drive}"
        )
    elif values["joint_states"] == "true":
        lines.append(f"  joints   {values['joints'] or 'swing within their limits'}")
    else:
        lines.append(f"  joints   wait for {space}/joint_states")
    if values.get("steer") == "true":
        nobody = "" if values["sim"] == "true" else "; nothing simulated listens to it"
        lines.append(f"  steer    in the browser; steering_page prints its address{nobody}")
    lines.append(f"  viewer   {_viewer_hint(values)}")
    if values["record"]:
        lines.append(f"  record   all topics to {values['record']}")
    lines.append("  Ctrl-C stops everything")
    return "\n".join(lines)


def _viewer_hint(values: Mapping[str, str]) -> str:
    hints = {
        "web": "in the browser; rerun_viewer prints its address",
        "native": "in a window of its own",
        "none": "none",
    }
    saved = f"; recorded to {values['save']}" if values["save"] else ""
    return hints[values["viewer"]] + saved
