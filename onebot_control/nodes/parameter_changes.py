"""Changes of a robot's parameters while its node runs."""

from collections.abc import Sequence
from dataclasses import replace

from rclpy.parameter import Parameter

from onebot_control.drive.parameters import ControlConfig
from onebot_control.nodes.robot_interface import RobotInterface, SharedWorld
from onebot_description.description.loading import load_sensors
from onebot_description.errors import OneBotError
from onebot_description.ros.description_topic import GOES_ON
from onebot_description.ros.parameters.reader import (
    ConfigError,
    Problem,
    follow_changes,
    refuse_undeclared,
)


class ParameterChanges:
    """Checks changes of a robot's parameters, and applies them."""

    def __init__(self, robot: RobotInterface, world: SharedWorld) -> None:
        """Accept changes from now on."""
        self._robot, self._world, self._settings = robot, world, robot.settings
        refuse_undeclared(robot.node, robot.settings.declared)
        follow_changes(robot.node, self._check, self._apply)

    def _check(self, parameters: Sequence[Parameter]) -> None:
        """Raise OneBotError if the changes cannot be applied."""
        slot = self._robot.slot
        config = self._settings.changed(parameters, self._world.simulated)
        self._check_effect(config)
        if slot.loop is not None:
            slot.robot.fitted(config)
            if config.sensors and config.sensors != self._settings.config.sensors:
                load_sensors(config.sensors, slot.robot.description)
            self._world.check_frames(slot.row, self._robot.frames(config))

    def _check_effect(self, config: ControlConfig) -> None:
        """Refuse changes of TF parameters that would have no effect.

        Raises:
            ConfigError: with the reason.
        """
        previous, in_scene = self._settings.config, self._world.scene is not None
        if in_scene and not config.world_frame_id and previous.world_frame_id:
            text = "the frames of a world need a parent; ground_truth_tf: false takes odom off it"
            raise ConfigError([Problem("world_frame_id", text)])
        if config.ground_truth_tf and not previous.ground_truth_tf:
            if not config.world_frame(in_scene=in_scene):
                text = "there is no frame to publish odom in; set world_frame_id first"
                raise ConfigError([Problem("ground_truth_tf", text)])

    def _apply(self, parameters: Sequence[Parameter]) -> None:
        settings, robot = self._settings, self._robot
        previous_config = settings.config
        settings.accept(parameters)
        config = settings.config
        if config == previous_config:
            return
        robot.step_topics.choose(config.step_topics)
        commands = robot.commands.subscription
        if commands is not None and config.cmd_vel_type != previous_config.cmd_vel_type:
            commands.choose(config.cmd_vel_type)
        if (loop := robot.slot.loop) is not None:
            try:
                loop.call(lambda: self._configure(config))
            except OneBotError as error:  # raised from this callback, it would end the process
                robot.refuse("parameters", f"parameters not applied, {GOES_ON}: {error}")
        if config.real_time_factor != self._world.factor:
            self._world.set_factor(config.real_time_factor)
        if replace(config, real_time_factor=previous_config.real_time_factor) != previous_config:
            robot.sense_again()

    def _configure(self, config: ControlConfig) -> None:
        """Apply parameters in the control thread."""
        slot = self._robot.slot
        slot.robot.configure(config)
        slot.running.set_factor(config.real_time_factor)
        self._robot.use(slot.robot)
