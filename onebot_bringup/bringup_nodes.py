"""The nodes of a description bringup, as processes to start."""

import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from onebot_bringup.description_files import digest_of
from onebot_bringup.joint_sweep import sweep_parameters
from onebot_bringup.launcher import Node, OnExit, python_node
from onebot_bringup.launcher.parameter_files import write_parameters
from onebot_description.description import Description, published_urdf


def output_path(text: str) -> Path:
    """Return the path of a file or folder to write; shells leave the ~ of ``name:=~/x`` to us."""
    return Path(text).expanduser().absolute()


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

    @property
    def steered(self) -> bool:
        """There is to be a page to steer from."""
        return self.values.get("steer") == "true"

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

    def velocity_controller(self) -> Node:
        """Return the simulation with its controller, which drives the robot."""
        parameters: dict[str, object] = {
            name: float(self.values[name]) for name in ("x", "y", "yaw")
        }
        # All nodes of the robot name its frames alike, in a namespace too.
        prefix = self.values["frame_prefix"]
        parameters |= {"tf_frame_prefix_enable": bool(prefix), "tf_frame_prefix": prefix}
        if self.values["rate"]:
            parameters["update_rate"] = int(self.values["rate"])
        module = "onebot_control.velocity_controller"
        files = [Path(self.values["params_file"]).absolute()]
        return self._node("velocity_controller", module, parameters, files=files)

    def rerun_viewer(self) -> Node:
        """Return the viewer, whose end stops nothing else."""
        parameters = {
            "viewer": self.values["viewer"],
            "save": self.values["save"],
            "view": self.values["view"],
            "fixed_frame": self._fixed_frame(),
            "frame_prefix": self.values["frame_prefix"],
            "open_browser": not self.steered,  # the steering page holds the view
        }
        module = "onebot_bringup.rerun_viewer"
        return self._node("rerun_viewer", module, parameters, on_exit="ignore")

    def steering_page(self) -> Node:
        """Return the page to steer from; it may crash without the robot's noticing.

        Its port and its token are chosen here, so that open pages find it again after a crash.

        Raises:
            OneBotError: the page cannot be served where it should be.
        """
        from onebot_bringup.steering.access import is_loopback, new_token
        from onebot_bringup.steering.serving import listen

        wanted, token = int(self.values["port"]), self.values["token"]
        with listen(self.values["host"], wanted) as probe:
            address, port = probe.getsockname()[:2]
        if wanted not in (0, port):
            print(f"warning: port {wanted} is in use; using {port} instead", file=sys.stderr)
        if not token and not is_loopback(address):
            token = new_token()
        parameters = {"host": self.values["host"], "port": port, "token": token}
        module = "onebot_bringup.steering_page"
        return self._node("steering_page", module, parameters, on_exit="restart")

    def bag_recorder(self) -> Node:
        """Return the recorder, whose end stops nothing else."""
        parameters = {"folder": str(output_path(self.values["record"]))}
        module = "onebot_bringup.bag_recorder"
        return self._node("bag_recorder", module, parameters, on_exit="ignore")

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
        files: Sequence[Path] = (),
    ) -> Node:
        namespace = self.values["namespace"].strip("/")
        all_parameters = {**parameters, "use_sim_time": self._flag("use_sim_time")}
        file = write_parameters(self.folder, name, all_parameters, namespace)
        ros_args = ["--log-level", self.values["log_level"]]
        for each in (*files, file):  # the later one goes before
            ros_args += ["--params-file", str(each)]
        if namespace:
            ros_args += ["-r", f"__ns:=/{namespace}"]
        arguments = [*words, "--ros-args", *ros_args, *self.ros_args]
        return python_node(name, module, arguments, on_exit=on_exit)

    def _fixed_frame(self) -> str:
        """The frame asked for; a robot that is not simulated, but could be, has no odom."""
        if not self.values["fixed_frame"] and self.values.get("sim") == "false":
            return self.values["frame_prefix"] + self.description.root_link
        return self.values["fixed_frame"]

    def _flag(self, name: str) -> bool:
        return self.values[name] == "true"
