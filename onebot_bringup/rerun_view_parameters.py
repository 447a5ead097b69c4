"""The settings of the viewer's view as ROS parameters, changed and saved while it runs."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from rcl_interfaces.msg import ParameterDescriptor, SetParametersResult
from rclpy.node import Node
from rclpy.parameter import Parameter
from std_srvs.srv import Trigger

from onebot_bringup.viewer.view_settings import settings, with_setting
from onebot_bringup.viewer.view_source import ViewSource
from onebot_description.errors import OneBotError

_FIXED_FRAME = "fixed_frame"
_SAVE_TO = "save_view_to"


class ViewParameters:
    """Keeps the node's parameters and its view equal, whichever of them changes."""

    def __init__(self, node: Node, source: ViewSource, changed: Callable[[], None]) -> None:
        """Declare the parameters, with the view's values where none are given.

        Args:
            node: whose parameters they are; it also serves ``~/save_view``.
            source: the view.
            changed: called after the user has changed a parameter.

        Raises:
            OneBotError: a parameter has a value that a view cannot have.
        """
        self._node = node
        self._source = source
        self._changed = changed
        self._mirroring = False
        self._names = frozenset(settings(source.view))
        for name, value in settings(source.view).items():
            self._declare(name, value)
        meaning = 'the file that ~/save_view writes; "" for the one that the view is from'
        node.declare_parameter(_SAVE_TO, "", ParameterDescriptor(description=meaning))
        self.mirror()
        node.add_on_set_parameters_callback(self._check)
        node.add_post_set_parameters_callback(self._take)
        node.create_service(Trigger, "~/save_view", self._save)

    def _declare(self, name: str, value: Any) -> None:
        descriptor = ParameterDescriptor(description="as in the view file", dynamic_typing=True)
        given = _plain(self._node.declare_parameter(name, value, descriptor).value)
        if given == value or (name == _FIXED_FRAME and given == ""):
            return
        try:
            self._source.change(name, given)
        except ValueError as error:
            raise OneBotError(str(error)) from error

    def mirror(self) -> None:
        """Set the parameters to what the view says now."""
        wanted = settings(self._source.view)
        stale = [
            Parameter(name, value=value)
            for name, value in wanted.items()
            if _plain(self._node.get_parameter(name).value) != value
        ]
        self._mirroring = True
        try:
            self._node.set_parameters(stale)
        finally:
            self._mirroring = False

    def _check(self, parameters: Sequence[Parameter]) -> SetParametersResult:
        view = self._source.view
        for parameter in parameters:
            if parameter.name in self._names:
                try:
                    view = with_setting(view, parameter.name, _plain(parameter.value))
                except ValueError as error:
                    return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def _take(self, parameters: Sequence[Parameter]) -> None:
        ours = [parameter for parameter in parameters if parameter.name in self._names]
        if self._mirroring or not ours:
            return
        for parameter in ours:
            self._source.change(parameter.name, _plain(parameter.value))
        self._changed()

    def _save(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        to = str(self._node.get_parameter(_SAVE_TO).value)
        try:
            path = self._source.save(Path(to) if to else None)
        except OneBotError as error:
            self._node.get_logger().warning(str(error))
            response.success, response.message = False, str(error)
            return response
        response.success, response.message = True, f"saved as {path}"
        self._node.get_logger().info(f"the view was saved as {path}")
        return response


def _plain(value: Any) -> Any:
    """A parameter's value as a view file has it: arrays as lists."""
    return value if value is None or isinstance(value, (bool, int, float, str)) else list(value)
