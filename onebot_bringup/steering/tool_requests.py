"""Handles the requests of the page's tools and panels, below /tools/: JSON over HTTP.

    GET ground[?frame=F]: the robot, its scans and the map in a frame, see ``Ground.fields``, and
        the ``command_topic`` of that robot.
    GET map.png: the picture of that map.
    GET camera.jpg?topic=T: the newest picture of a camera, which is then subscribed to for a while.
    POST click: publishes a click, see ``Click``; responds with ``topic`` and ``subscribers``.
    GET nodes: ``nodes`` with parameters, the robot's controllers first; the ``viewer``, "" for
        none; and ``shown``, the ``topic``, ``type`` and ``visible`` of each topic in it.
    GET parameters?node=N: the node's ``parameters``.
    POST parameters: ``node`` and ``values``, YAML by name; responds with why each was rejected.

While there is no picture, the response has no content (204). The response to a failed request has
``error``, a sentence, and a status of at least 400.
"""

import asyncio
import math
import threading
import time
from collections.abc import Callable, Mapping
from concurrent.futures import Future
from dataclasses import dataclass
from functools import partial
from typing import Any, TypeVar

from aiohttp import web
from rclpy.node import Node

from onebot_bringup.introspection.parameter_client import ParameterClient
from onebot_bringup.introspection.parameter_values import text_of, type_label
from onebot_bringup.serving.http_server import body_of
from onebot_bringup.steering.camera import CameraFeed
from onebot_bringup.steering.command_topic import CommandTopic
from onebot_bringup.steering.ground import Ground, picture
from onebot_bringup.steering.protocol import ProtocolError, read_request
from onebot_bringup.steering.tools import Click, ToolPublishers
from onebot_description.errors import OneBotError
from onebot_description.parameters.reader import REQUIRED, parameter

T = TypeVar("T")

_POLL = 0.01  # s
_TIMEOUT = 5.0  # s to wait for the node's thread
_LONGEST_VALUE = 1000  # characters; longer values, such as a description, cannot be edited here


class OtherThread:
    """Provides a node as a ``SpinningNode`` to threads that do not spin it."""

    def __init__(self, node: Node) -> None:
        self._node = node
        self._closed = threading.Event()

    @property
    def node(self) -> "OtherThread":
        """This object, which creates and destroys clients."""
        return self

    def create_client(self, kind: Any, name: str) -> Any:
        return self.call(lambda: self._node.create_client(kind, name))

    def destroy_client(self, client: Any) -> None:
        """Have the node's thread destroy a client, without waiting for it."""
        executor = self._node.executor
        if executor is not None:
            executor.create_task(self._node.destroy_client, client)

    def call(self, action: Callable[[], T]) -> T:
        """Run ``action`` in the node's thread and return its result.

        Raises:
            OneBotError: the node does not spin, or is ending; an action not yet begun is dropped.
        """
        done: Future[T] = Future()

        def run() -> None:
            if done.set_running_or_notify_cancel():
                try:
                    done.set_result(action())
                except Exception as error:
                    done.set_exception(error)

        if executor := self.spin(lambda: self._node.executor, _TIMEOUT):
            executor.create_task(run)
            self.spin(done.done, _TIMEOUT)
        if done.cancel():
            raise OneBotError("the page's node is not answering")
        self.spin(done.done, math.inf)  # the action has begun
        return done.result()

    def spin(self, until: Callable[[], Any], timeout: float) -> Any:
        """Wait until ``until()`` is true while the node's thread runs its callbacks."""
        deadline = time.monotonic() + timeout
        while not (value := until()) and time.monotonic() < deadline:
            if self._closed.wait(_POLL):
                raise OneBotError("the page's node is ending")
        return value

    def close(self) -> None:
        self._closed.set()


@dataclass
class ToolRequests:
    """The routes below /tools/, which call parts of the node in its thread."""

    thread: OtherThread
    commands: CommandTopic
    ground: Ground
    cameras: CameraFeed
    publishers: ToolPublishers
    nodes: Callable[[], Mapping[str, Any]]

    def routes(self) -> list[web.RouteDef]:
        return [
            web.get("/tools/map.png", self._get_map),
            web.get("/tools/camera.jpg", self._get_camera),
            web.get("/tools/ground", _json(self._look)),
            web.get("/tools/nodes", _json(lambda *_: self.thread.call(self.nodes))),
            web.post("/tools/click", _json(self._click)),
            web.get("/tools/parameters", _json(self._parameters)),
            web.post("/tools/parameters", _json(self._set_parameters)),
        ]

    async def _get_map(self, _: web.Request) -> web.Response:
        grid = self.ground.grid
        data = await asyncio.to_thread(picture, grid) if grid is not None else None
        return _picture(data, "image/png")

    async def _get_camera(self, request: web.Request) -> web.Response:
        topic = request.query.get("topic", "")
        return _picture(await asyncio.to_thread(self.cameras.picture, topic), "image/jpeg")

    def _look(self, query: Mapping[str, str], _: str) -> Mapping[str, Any]:
        def look() -> Mapping[str, Any]:
            self.publishers.prepare()
            fields = self.ground.fields(query.get("frame", ""))
            return {**fields, "command_topic": self.commands.topic} if fields else {}

        found: Mapping[str, Any] = self.thread.spin(lambda: self.thread.call(look), _TIMEOUT)
        return found

    def _click(self, _: Mapping[str, str], body: str) -> Mapping[str, Any]:
        click = read_request(Click, body)
        topic, subscribers = self.thread.call(partial(self.publishers.publish, click))
        return {"topic": topic, "subscribers": subscribers}

    def _parameters(self, query: Mapping[str, str], _: str) -> Mapping[str, Any]:
        return {"parameters": rows_of(self._client(query.get("node", "")))}

    def _set_parameters(self, _: Mapping[str, str], body: str) -> Mapping[str, Any]:
        request = read_request(SetParameters, body)
        client = self._client(request.node)
        results = client.set(list(request.values.items()), same_types=True)
        rejected = {
            name: result.reason or "the node rejected it"
            for name, result in zip(request.values, results, strict=True)
            if not result.successful
        }
        return {"rejected": rejected}

    def _client(self, node: str) -> ParameterClient:
        if node not in self.thread.call(self.nodes)["nodes"]:
            raise OneBotError(f'there is no node "{node}"')
        return ParameterClient(self.thread, node)


def _picture(data: bytes | None, kind: str) -> web.Response:
    """Return a response with a picture, or without content if there is none (yet)."""
    return web.Response(status=204) if data is None else web.Response(body=data, content_type=kind)


def _json(action: Callable[[Mapping[str, str], str], Mapping[str, Any]]) -> Any:
    """Return a handler that responds with what an action returns, given query and body.

    The action may wait: it runs in another thread.
    """

    async def respond(request: web.Request) -> web.Response:
        body = (await body_of(request)).decode(errors="replace")
        try:
            return web.json_response(await asyncio.to_thread(action, request.query, body))
        except OneBotError as error:
            status = 400 if isinstance(error, ProtocolError) else 409
            return web.json_response({"error": f"{error}."}, status=status)

    return respond


@dataclass(frozen=True)
class SetParameters:
    """A request to set parameters of a node."""

    node: str = parameter(REQUIRED, "its full name", not_empty=True)
    values: Mapping[str, str] = parameter({}, "values in YAML, by name")


def rows_of(client: ParameterClient) -> list[Mapping[str, Any]]:
    """Return the parameters of a node as a page shows them, sorted by name."""
    names = sorted(client.names())
    pairs = zip(client.describe(names), client.values(names), strict=True)
    rows = [_row(*pair) for pair in pairs]
    return [row for row in rows if len(row["value"]) <= _LONGEST_VALUE]


def _row(descriptor: Any, value: Any) -> Mapping[str, Any]:
    ranges = [*descriptor.floating_point_range, *descriptor.integer_range]
    return {
        "name": descriptor.name,
        "type": type_label(value.type),
        "value": text_of(value),
        "description": descriptor.description,
        "rule": descriptor.additional_constraints,
        "read_only": descriptor.read_only,
        "range": [ranges[0].from_value, ranges[0].to_value] if ranges else None,
    }
