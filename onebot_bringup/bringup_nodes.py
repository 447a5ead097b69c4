"""The nodes of a description bringup, as processes to start."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from onebot_bringup.description_files import digest_of
from onebot_bringup.joint_sweep import sweep_parameters
from onebot_bringup.launcher import Node, OnExit, python_node
from onebot_bringup.launcher.parameter_files import write_parameters
from onebot_description.description import Description, published_urdf


@dataclass(frozen=True)
class NodeFactory:
    """Makes nodes out of the values of the launch arguments.

    Attributes:
        folder: where the nodes' parameter files are written.
        values: of the launch arguments.
        description: of the robot.
        xacro_arguments: with which it was read.
        ros_args: for every node, after its own.
    """

    folder: Path
    values: Mapping[str, str]
    description: Description
    xacro_arguments: Mapping[str, str]
    ros_args: Sequence[str]

    def robot_state_publisher(self) -> Node:
        """Return the node that publishes the robot's transforms; nothing works without it."""
        parameters = {
            "robot_description": published_urdf(self.description),
            "frame_prefix": self.values["frame_prefix"],
            "publish_frequency": float(self.values["publish_frequency"]),
            "ignore_timestamp": self._flag("ignore_timestamp"),
        }
        module = "onebot_description.robot_state_publisher"
        return self._node("robot_state_publisher", module, parameters)

    def joint_state_publisher(self) -> Node:
        """Return the node that moves the joints, by the YAML file or else within their limits."""
        module = "onebot_description.joint_state_publisher"
        file = self.values["joints"]
        parameters = {"config_file": file} if file else sweep_parameters(self.description)
        return self._node("joint_state_publisher", module, parameters)

    def rerun_viewer(self) -> Node:
        """Return the viewer, whose end stops nothing else."""
        parameters = {
            "viewer": self.values["viewer"],
            "save": self.values["save"],
            "view": self.values["view"],
            "fixed_frame": self.values["fixed_frame"],
            "frame_prefix": self.values["frame_prefix"],
        }
        module = "onebot_bringup.rerun_viewer"
        return self._node("rerun_viewer", module, parameters, on_exit="ignore")

    def description_watcher(self) -> Node:
        """Return the node that takes up edits of the model; it only serves those who edit."""
        words = ["--digest", digest_of(published_urdf(self.description)), self.values["model"]]
        words += [f"{name}:={value}" for name, value in self.xacro_arguments.items()]
        module = "onebot_bringup.description_watcher"
        return self._node("description_watcher", module, {}, words, on_exit="ignore")

    def _node(
        self,
        name: str,
        module: str,
        parameters: Mapping[str, object],
        words: Sequence[str] = (),
        on_exit: OnExit = "shutdown",
    ) -> Node:
        namespace = self.values["namespace"].strip("/")
        all_parameters = {**parameters, "use_sim_time": self._flag("use_sim_time")}
        file = write_parameters(self.folder, name, all_parameters, namespace)
        ros_args = ["--log-level", self.values["log_level"], "--params-file", str(file)]
        if namespace:
            ros_args += ["-r", f"__ns:=/{namespace}"]
        arguments = [*words, "--ros-args", *ros_args, *self.ros_args]
        return python_node(name, module, arguments, on_exit=on_exit)

    def _flag(self, name: str) -> bool:
        return self.values[name] == "true"
