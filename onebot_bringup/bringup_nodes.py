"""The nodes of a description bringup, as processes to start."""

import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from onebot_bringup.description_files import Known
from onebot_bringup.joint_sweep import sweep_parameters
from onebot_bringup.launcher.node import Node, OnExit
from onebot_bringup.ros_nodes import NICE_VIEWER, NICE_WATCHER, RosNodes
from onebot_description.description import Description


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
        urdf: the same as the nodes get it.
        xacro_arguments: with which it was read.
        ros_args: for every node, after its own.
        known: the files that the description was read from.
    """

    folder: Path
    values: Mapping[str, str]
    description: Description
    urdf: str
    xacro_arguments: Mapping[str, str]
    ros_args: Sequence[str]
    known: Known

    @property
    def steered(self) -> bool:
        """There is to be a page to steer from."""
        return self.values.get("steer") == "true"

    def robot_state_publisher(self) -> Node:
        """Return the node that publishes the robot's transforms; nothing works without it."""
        parameters = {
            "robot_description": self.urdf,
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
        # It would come on the topic, too, but only when robot_state_publisher is up.
        parameters["robot_description"] = self.urdf
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
        return self._node("rerun_viewer", module, parameters, on_exit="ignore", nice=NICE_VIEWER)

    def steering_page(self) -> Node:
        """Return the page to steer from; it may crash without the robot's noticing.

        Its port and its token are settled here, so that open pages find it again after a crash.

        Raises:
            OneBotError: the page cannot be served where it should be.
        """
        from onebot_bringup.steering.place import choose_place  # few need it

        place = choose_place(self.values["host"], int(self.values["port"]), self.values["token"])
        if place.warning:
            print(f"warning: {place.warning}", file=sys.stderr)
        module = "onebot_bringup.steering_page"
        return self._node("steering_page", module, place.parameters, on_exit="restart")

    def bag_recorder(self) -> Node:
        """Return the recorder, whose end stops nothing else."""
        parameters = {"folder": str(output_path(self.values["record"]))}
        module = "onebot_bringup.bag_recorder"
        return self._node("bag_recorder", module, parameters, on_exit="ignore")

    def description_watcher(self) -> Node:
        """Return the node that takes up edits of the model; it only serves those who edit."""
        words = ["--known", self.known.to_json(), self.values["model"]]
        words += [f"{name}:={value}" for name, value in self.xacro_arguments.items()]
        module = "onebot_bringup.description_watcher"
        return self._node(
            "description_watcher", module, {}, words, on_exit="ignore", nice=NICE_WATCHER
        )

    def _node(
        self,
        name: str,
        module: str,
        parameters: Mapping[str, object],
        words: Sequence[str] = (),
        on_exit: OnExit = "shutdown",
        files: Sequence[Path] = (),
        nice: int = 0,
    ) -> Node:
        make = RosNodes(
            self.folder, self.values["namespace"], self.ros_args, self.values["log_level"]
        )
        return make.node(
            name,
            module,
            {**parameters, "use_sim_time": self._flag("use_sim_time")},
            words=words,
            on_exit=on_exit,
            files=files,
            nice=nice,
        )

    def _fixed_frame(self) -> str:
        """The frame asked for; a robot that is not simulated, but could be, has no odom."""
        if not self.values["fixed_frame"] and self.values.get("sim") == "false":
            return self.values["frame_prefix"] + self.description.root_link
        return self.values["fixed_frame"]

    def _flag(self, name: str) -> bool:
        return self.values[name] == "true"
