"""How fast the steered robot may go, asked of its controller."""

import math
import time
from collections.abc import Iterable
from typing import Any

from rcl_interfaces.srv import GetParameters
from rclpy.node import Node

from onebot_bringup.steering.protocol import Velocity
from onebot_bringup.steering_topics import Listener

_ANSWER_BY = 5.0  # s; a controller that is alive answers at once
_LIMITS = ("linear.x.max_velocity", "angular.z.max_velocity")
_DOUBLE, _INTEGER = 3, 2  # rcl_interfaces/msg/ParameterType


class ControllerLimits:
    """Asks the robot's controller how fast it may go, by its parameters."""

    def __init__(self, node: Node) -> None:
        """Ask nobody yet."""
        self._node = node
        self._asked = ""
        self._since = 0.0
        self._client: Any = None
        self._answer: Any = None

    def look(self, robots: Iterable[Listener]) -> Velocity | None:
        """Ask, if it is a new robot; return its limits, once, as soon as they are there.

        A limit that it does not tell, or that is none, comes out as NaN.
        """
        names = [robot.node for robot in robots]
        if not names:  # the next one is a new one, whatever its name
            self._drop()
            self._asked = ""
        elif self._asked not in names:
            self._drop()
            self._asked = names[0]
            service = f"{self._asked}/get_parameters"
            self._client = self._node.create_client(GetParameters, service)
        if self._client is None:
            return None
        if self._answer is not None and time.monotonic() - self._since > _ANSWER_BY:
            self._forget()  # whom it was sent to may have died, and come back, since then
        if self._answer is None and self._client.service_is_ready():
            self._answer = self._client.call_async(GetParameters.Request(names=_LIMITS))
            self._since = time.monotonic()
        if self._answer is None or not self._answer.done():
            return None
        values = [_number(value) for value in self._answer.result().values]
        self._drop()
        return Velocity(*values) if len(values) == len(_LIMITS) else Velocity(math.nan, math.nan)

    def _forget(self) -> None:
        self._client.remove_pending_request(self._answer)
        self._answer = None

    def _drop(self) -> None:
        if self._client is not None:
            self._node.destroy_client(self._client)
        self._client = self._answer = None


def _number(value: Any) -> float:
    number = {_DOUBLE: value.double_value, _INTEGER: value.integer_value}.get(value.type, math.nan)
    return float(number) if math.isfinite(number) and number > 0.0 else math.nan
