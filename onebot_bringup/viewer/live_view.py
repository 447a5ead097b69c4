"""Keeps the view of a running viewer up to date with its parameters and its file."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from rclpy.node import Node
from rclpy.parameter import Parameter
from std_srvs.srv import Trigger

from onebot_bringup.viewer.view_config import ViewConfig
from onebot_bringup.viewer.view_source import ViewSource
from onebot_description.errors import OneBotError
from onebot_description.parameters.reader import is_parameter, replaced, values_of
from onebot_description.parameters.values import plain
from onebot_description.ros.node_parameters import (
    declare,
    follow_changes,
    refuse_undeclared,
    ros_parameter,
)

_FIXED_FRAME = "fixed_frame"
_SAVE_TO = "save_view_to"


class LiveView:
    """Keeps the node's parameters and its view equal; logs mistakes, which change nothing.

    Attributes:
        source: the view and where it comes from.
    """

    def __init__(self, node: Node, own: Any, apply: Callable[[], None]) -> None:
        """Declare the settings as parameters, with the view's values where none are given.

        Args:
            node: the node that gets the parameters and serves ``~/save_view``.
            own: the node's other parameters, with ``view`` and ``save_view_to``.
            apply: called after each change of the view.

        Raises:
            OneBotError: there is no such view, or a parameter has an invalid value.
        """
        self._node, self._own, self._log = node, own, node.get_logger()
        self._apply = apply
        self.source = ViewSource(own.view, self._log.warning)
        self._mirroring = False
        self._declare()
        self._mirror()
        refuse_undeclared(node, ViewConfig)
        follow_changes(node, self._check, self._take)
        node.create_service(Trigger, "~/save_view", self._save)

    # --- parameters -----------------------------------------------------------------------------

    def _declare(self) -> None:
        usual = values_of(self.source.view)
        for name, value in declare(self._node, ViewConfig, usual).items():
            if value != usual[name] and (name != _FIXED_FRAME or value != ""):
                self.source.change(name, value)

    def _mirror(self) -> None:
        stale = [
            ros_parameter(name, value)
            for name, value in values_of(self.source.view).items()
            if plain(self._node.get_parameter(name).value) != value
        ]
        self._mirroring = True
        try:
            self._node.set_parameters(stale)
        finally:
            self._mirroring = False

    def _check(self, parameters: Sequence[Parameter]) -> None:
        view = self.source.view
        for parameter in parameters:
            if parameter.name == _SAVE_TO:
                replaced(self._own, parameter.name, parameter.value)
            elif is_parameter(ViewConfig, parameter.name):
                view = replaced(view, parameter.name, plain(parameter.value))

    def _take(self, parameters: Sequence[Parameter]) -> None:
        settings = [setting for setting in parameters if is_parameter(ViewConfig, setting.name)]
        if self._mirroring or not settings:
            return
        for setting in settings:
            self.source.change(setting.name, plain(setting.value))
        self._apply()

    def _save(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        to = str(self._node.get_parameter(_SAVE_TO).value)
        try:
            response.message = f"saved as {self.source.save(Path(to) if to else None)}"
            response.success = True
            self._log.info(f"the view was {response.message}")
        except OneBotError as error:
            response.success, response.message = False, str(error)
            self._log.warning(str(error))
        return response

    # --- files ----------------------------------------------------------------------------------

    def poll(self) -> None:
        """Apply edits of the view's file; call this periodically."""
        for file in self.source.poll():
            try:
                if self.source.reload():
                    self._changed(f"{file} was edited: the view is up to date")
            except OneBotError as error:
                self._log.warning(f"keeping the view shown so far: {error}")

    def set_robot(self, robot: str) -> None:
        """Use the view in the robot's description package, unless the user has given another."""
        try:
            if self.source.set_robot(robot):
                self._changed(f"its view is {self.source.file or 'the default'}")
        except OneBotError as error:
            self._log.warning(f"keeping the view shown so far: {error}")

    def _changed(self, text: str) -> None:
        self._mirror()
        self._apply()
        self._log.info(text)
