"""Makes the content of ``ros2 launch`` files: a bringup's arguments, and its script to run.

ros2 launch only starts the script and not the nodes: the script checks arguments, files and
description before any node starts, and supervises and stops the nodes by rules that ros2 launch
does not have. It also avoids a second list of nodes.
"""

import sys
from collections.abc import Mapping
from types import ModuleType
from typing import Any

from onebot_bringup.launch.bringup import Bringup

# The launch configuration in which PushRosNamespace of launch_ros stores the namespace.
_PUSHED = "ros_namespace"


def launch_description(script: ModuleType) -> Any:
    """Return the LaunchDescription that runs a bringup script.

    Args:
        script: the script's module, whose ``command()`` describes it.
    """
    # These belong to ROS: they are installed if ros2 launch is.
    from launch import LaunchDescription
    from launch.actions import DeclareLaunchArgument, ExecuteProcess, OpaqueFunction

    command: Bringup = script.command()
    of_model, _ = command.model_arguments({})
    arguments = [*command.arguments(), *of_model]
    configurations: dict[str, str] = {}

    def start(context: Any) -> list[Any]:
        configurations.update(context.launch_configurations)
        process = [sys.executable, "-m", script.__name__, *words(command, configurations)]
        return [ExecuteProcess(cmd=process, name=command.program, output="screen")]

    def forget_defaults(context: Any) -> None:
        for argument in arguments:
            if argument.name not in configurations:
                context.launch_configurations.pop(argument.name, None)

    return LaunchDescription(
        [
            OpaqueFunction(function=start),  # first, while only given arguments have a value
            *(
                DeclareLaunchArgument(a.name, default_value=a.default, description=a.help)
                for a in arguments
            ),
            # A launch file may include this one twice, or others with the same argument names.
            OpaqueFunction(function=forget_defaults),
        ]
    )


def words(command: Bringup, configurations: Mapping[str, str]) -> list[str]:
    """Return the command line: all launch configurations that the bringup knows.

    Others may belong to the launch file that includes this one.
    """
    of_model, _ = command.model_arguments(configurations)
    names = {argument.name for argument in (*command.arguments(), *of_model)}
    assignments = {name: value for name, value in configurations.items() if name in names}
    if pushed := configurations.get(_PUSHED):
        namespace = assignments.get("namespace", "")
        assignments["namespace"] = (
            namespace if namespace.startswith("/") else f"{pushed}/{namespace}"
        )
    return [f"{name}:={value}" for name, value in assignments.items()]
