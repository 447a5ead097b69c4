"""The node of description_watcher: it hands the edited robot on to robot_state_publisher."""

from pathlib import Path
from typing import Any

from rcl_interfaces.srv import SetParameters
from rclpy.node import Node
from rclpy.parameter import Parameter

from onebot_bringup.description_files import LOOK_EVERY, Signature, digest_of, signature_of
from onebot_bringup.xacro_arguments import included_files
from onebot_description.description import load_description, published_urdf
from onebot_description.errors import OneBotError

_PUBLISHER = "robot_state_publisher"


class DescriptionUpdate(Node):
    """See the docstring of ``onebot_bringup.description_watcher``."""

    def __init__(self, model: str, arguments: dict[str, str], digest: str) -> None:
        """Watch ``model`` and what it includes.

        Args:
            model: a URDF or xacro file.
            arguments: of xacro.
            digest: of the URDF that robot_state_publisher has (see ``digest_of``); empty: unknown.
        """
        super().__init__("description_watcher")
        self._model = model
        self._arguments = arguments
        self._sent = digest
        self._files: tuple[Path, ...] = included_files(model)
        self._last_look: Signature | None = None
        self._loaded: Signature | None = None
        self._client = self.create_client(SetParameters, f"{_PUBLISHER}/set_parameters")
        self.create_timer(LOOK_EVERY, self._look)

    def _look(self) -> None:
        """Load if a file has changed, and once at the start: it may have changed by then."""
        if not self._client.service_is_ready():
            return  # and find the change once it is
        signature = signature_of(self._files)
        if signature != self._last_look:  # an editor may still be writing
            self._last_look = signature
        elif signature != self._loaded:
            self._loaded = signature
            self._load()

    def _load(self) -> None:
        try:
            description = load_description(self._model, self._arguments)
        except OneBotError as error:
            self.get_logger().error(f"{error}\nThe robot stays as it was until this is mended.")
            # Where the mistake is may be a file that was included only just now.
            self._watch((*self._files, *included_files(self._model)))
            return
        self._watch(description.files)
        self._send(published_urdf(description))

    def _watch(self, files: tuple[Path, ...]) -> None:
        files = tuple(dict.fromkeys(files))
        if files != self._files:
            self._files = files
            self._loaded = self._last_look = signature_of(files)

    def _send(self, urdf: str) -> None:
        digest = digest_of(urdf)
        if digest == self._sent:
            return
        self._sent = digest
        parameter = Parameter("robot_description", value=urdf).to_parameter_msg()
        future = self._client.call_async(SetParameters.Request(parameters=[parameter]))
        future.add_done_callback(self._on_answer)

    def _on_answer(self, future: Any) -> None:
        result = future.result().results[0]
        if result.successful:
            self.get_logger().info(f"{self._model} was edited: the robot is up to date")
        else:
            self._sent = ""
            self.get_logger().error(f"{_PUBLISHER} refused the edited robot: {result.reason}")
