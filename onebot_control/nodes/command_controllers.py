"""Finds the controllers among the nodes that subscribe to commands, and reads their limits.

The parameters of every subscriber are requested: a node with velocity limits is a controller, and
other nodes (a recorder, a viewer, a bridge) are ignored. rclpy's AsyncParameterClient is not used:
it creates six clients for each subscriber, and cannot destroy them.
"""

import time
from collections.abc import Callable, Iterable
from functools import partial
from typing import Any

from rcl_interfaces.srv import GetParameters, ListParameters
from rclpy.exceptions import InvalidServiceNameException
from rclpy.node import Node
from rclpy.parameter import parameter_value_to_python

from onebot_control.drive.controller_limits import NAMES, PREFIXES, ControllerLimits

_PERIOD = 2.0  # s between requests to a node, answered or not


class Controllers:
    """The controllers on the command topic."""

    def __init__(self, node: Node, changed: Callable[[], None]) -> None:
        """Start with none; ``changed`` is called when ``known`` has changed."""
        self._node, self._changed = node, changed
        self._inquiries: dict[str, _Inquiry] = {}
        self.known: tuple[ControllerLimits, ...] = ()

    @property
    def names(self) -> list[str]:
        return [controller.node for controller in self.known]

    def update(self, subscribers: Iterable[str]) -> None:
        """Update the nodes that subscribe to commands; call this several times per second.

        The limits of controllers that have left are kept until another one is known: a restarted
        robot may subscribe before its parameters can be read.
        """
        names = set(subscribers)
        for name in self._inquiries.keys() - names:
            self._inquiries.pop(name).close()
        for name in sorted(names - self._inquiries.keys()):
            try:
                self._inquiries[name] = _Inquiry(self._node, name, self._learn)
            except InvalidServiceNameException:
                pass  # a program that is not a ROS node
        for inquiry in self._inquiries.values():
            inquiry.poll()
        self._learn()

    def forget(self) -> None:
        for inquiry in self._inquiries.values():
            inquiry.close()
        self._inquiries.clear()
        self._set(())

    def _learn(self) -> None:
        inquiries = sorted(self._inquiries.items())
        controllers = [inquiry.controller for _, inquiry in inquiries if inquiry.controller]
        if controllers:
            self._set(tuple(controllers))

    def _set(self, controllers: tuple[ControllerLimits, ...]) -> None:
        # Compare as text, since missing limits are NaN, which never equals NaN.
        if repr(controllers) != repr(self.known):
            self.known = controllers
            self._changed()


class _Inquiry:
    """Requests the parameters of one node periodically."""

    def __init__(self, node: Node, name: str, answered: Callable[[], None]) -> None:
        self._node, self._name, self._answered = node, name, answered
        self._list = node.create_client(ListParameters, f"{name}/list_parameters")
        self._get = node.create_client(GetParameters, f"{name}/get_parameters")
        self._pending: tuple[Any, Any] | None = None  # the client, and the pending response
        self.due = 0.0  # when to request the parameters again
        self.controller: ControllerLimits | None = None

    def poll(self) -> None:
        now = time.monotonic()
        if now >= self.due and self._list.service_is_ready() and self._get.service_is_ready():
            self.due = now + _PERIOD
            request = ListParameters.Request(prefixes=PREFIXES)
            self._send(self._list, request, self._on_names)

    def close(self) -> None:
        self._drop()
        self._node.destroy_client(self._list)
        self._node.destroy_client(self._get)

    def _send(self, client: Any, request: Any, then: Callable[[Any], None]) -> None:
        self._drop()
        future = client.call_async(request)
        self._pending = client, future
        future.add_done_callback(partial(self._receive, then))

    def _drop(self) -> None:
        """Drop the last request, as a node that has died never responds."""
        if self._pending is not None:
            client, future = self._pending
            client.remove_pending_request(future)
        self._pending = None

    def _receive(self, then: Callable[[Any], None], future: Any) -> None:
        if self._pending is not None and self._pending[1] is future:
            self._pending = None
            then(future.result())

    def _on_names(self, response: Any) -> None:
        # Request only existing ones: for others, rclcpp would warn in the controller's log.
        names = sorted(NAMES.intersection(response.result.names))
        if names:
            self._send(self._get, GetParameters.Request(names=names), partial(self._read, names))
        else:
            self._read(names, GetParameters.Response())

    def _read(self, names: list[str], response: Any) -> None:
        if len(names) != len(response.values):
            return  # one of them has just been undeclared; they will be requested again
        values = map(parameter_value_to_python, response.values)
        self.controller = ControllerLimits.from_parameters(
            self._name, dict(zip(names, values, strict=True))
        )
        self._answered()
