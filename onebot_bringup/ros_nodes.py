"""ROS nodes of one launch, as processes: what they share, and parameters of their own in files."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from onebot_bringup.launcher.node import Node, OnExit, python_node
from onebot_bringup.launcher.parameter_files import write_parameters

# Where processors are short, the robot comes before what shows it (see nice(2)).
NICE_VIEWER, NICE_WATCHER = 5, 10


@dataclass(frozen=True)
class RosNodes:
    """Makes the nodes of one launch.

    Attributes:
        folder: where the nodes' parameter files are written.
        namespace: of all nodes; outer slashes do not matter.
        ros_args: for every node, after its own.
        log_level: the least severe messages shown; empty for the node's default.
    """

    folder: Path
    namespace: str
    ros_args: Sequence[str] = ()
    log_level: str = ""

    def node(
        self,
        name: str,
        module: str,
        parameters: Mapping[str, object],
        *,
        words: Sequence[str] = (),
        on_exit: OnExit = "shutdown",
        files: Sequence[Path] = (),
        renamed: bool = False,
        nice: int = 0,
    ) -> Node:
        """Return a node to start, and write its parameters.

        Args:
            name: of the node.
            module: that it is run from.
            parameters: of its own; as for ``write_parameters``.
            words: before its ROS arguments.
            on_exit: what happens when it ends although nobody asked it to.
            files: further parameter files; ``parameters`` go before them.
            renamed: its module calls it otherwise. Not for a module with several nodes, which
                would all get the name.
            nice: as ``Node.nice``.
        """
        namespace = self.namespace.strip("/")
        file = write_parameters(self.folder, name, parameters, namespace)
        ros_args = ["--log-level", self.log_level] if self.log_level else []
        for each in (*files, file):  # the later one goes before
            ros_args += ["--params-file", str(each)]
        if renamed:
            ros_args += ["-r", f"__node:={name}"]
        if namespace:
            ros_args += ["-r", f"__ns:=/{namespace}"]
        arguments = [*words, "--ros-args", *ros_args, *self.ros_args]
        return python_node(name, module, arguments, on_exit=on_exit, nice=nice)
