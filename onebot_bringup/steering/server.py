"""The steering page's server: the page, its WebSocket and the robot's view on one port."""

import asyncio
import mimetypes
import secrets
import time
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from aiohttp import WebSocketError, WSMsgType, web

from onebot_bringup.serving.connections import KEEP
from onebot_bringup.serving.origin import foreign_refusal
from onebot_bringup.steering.access import Access, other_site
from onebot_bringup.steering.arbiter import ThreadSafeArbiter
from onebot_bringup.steering.command_topic import CommandedRobot
from onebot_bringup.steering.limits import Braking, Limits
from onebot_bringup.steering.protocol import (
    ChooseTopic,
    ProtocolError,
    error_text,
    parse,
    stamp_of,
    state_text,
    velocity_fields,
    welcome_text,
)
from onebot_bringup.steering.tool_requests import ToolRequests
from onebot_bringup.steering.view_proxy import ViewProxy

STATIC = Path(__file__).parent / "static"
STATE_PERIOD = 0.1  # s
_MIN_PERIOD = 0.02  # s between two states, even if more changes
_HEARTBEAT = 5.0  # s between two pings; a page that does not respond counts as closed
_MAX_MESSAGE = 1 << 16  # bytes; beyond it the connection is closed
_MAX_PAGES = 64
_MOST_OF_A_PEER = 32  # pages
GAVE_WAY = 4000  # code of a WebSocket that is closed for another page
_HEADERS = {
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cache-Control": "no-cache",
}


@dataclass(frozen=True)
class RobotStatus:
    """The part of a page's state that the node provides."""

    topic: str  # the full name of the command topic
    topic_type: str = "geometry_msgs/msg/Twist"
    topics: tuple[str, ...] = ()  # the topics to choose from, those with subscribers first
    robots: tuple[CommandedRobot, ...] = ()  # to choose from
    listeners: int = 0  # the number of subscribers
    others: tuple[str, ...] = ()  # the other nodes that publish commands
    locked: bool = False  # it ignores all commands until a page drives again
    controllers: tuple[str, ...] = ()  # the nodes whose limits are known
    braking: Braking | None = None  # None if no controller is known
    odometry: Mapping[str, Any] | None = None  # its fields in the state
    camera: str = ""  # the topic of its pictures
    obstacle: float | None = None  # m until it meets what its scan sees


@dataclass
class ServerContext:
    """What the server needs of the node."""

    arbiter: ThreadSafeArbiter
    access: Access
    view: ViewProxy
    tools: ToolRequests
    robot: Callable[[], RobotStatus]
    # Called with the name of a page and of the topic that it chose; ``show_topic_error`` of the
    # server replies to that page if the topic cannot be used.
    choose_topic: Callable[[str, str], None]
    # Called with the problem of each rejected message, and whether its page drove.
    rejected: Callable[[str, bool], None]
    # Called when a page has gone: with why its connection was lost, "" if it was closed, and
    # whether it drove.
    ended: Callable[[str, bool], None]
    rate: float  # of commands, Hz


class SteeringServer:
    """The aiohttp application."""

    def __init__(self, context: ServerContext) -> None:
        self._context = context
        self._pages: dict[web.WebSocketResponse, _Page] = {}
        self._closing: set[asyncio.Future[bool]] = set()  # of pages that gave way
        self.app = web.Application(middlewares=[self._guard], client_max_size=_MAX_MESSAGE)
        self.app.on_response_prepare.append(self._add_headers)
        self.app.on_shutdown.append(self._close_pages)
        self._files = {
            str(file.relative_to(STATIC)): file.read_bytes()
            for file in STATIC.rglob("*")
            if file.is_file()
        }
        self.app.router.add_get("/", self._file)
        self.app.router.add_get("/ws", self._serve_page)
        self.app.router.add_get("/static/{path:.+}", self._file)
        context.view.add_to(self.app)
        context.tools.add_to(self.app)

    def notify(self) -> None:
        """Send all pages the state now; to be called in the server's thread."""
        for page in self._pages.values():
            page.changed.set()

    def show_topic_error(self, name: str, sentence: str) -> None:
        """Send one page why its topic cannot be used; to be called in the server's thread."""
        for page in self._pages.values():
            if page.name == name:
                page.errors.append(error_text(sentence, "topic", "topic"))
                page.changed.set()

    @web.middleware
    async def _guard(self, request: web.Request, handler: Any) -> web.StreamResponse:
        access = self._context.access
        host, origin = request.headers.get("Host", ""), request.headers.get("Origin")
        if self._context.view.has_key(request):
            refusal = access.view_refusal(host, origin)
        else:
            token, cookie = request.query.get("token"), request.cookies.get(access.cookie_name)
            refusal = foreign_refusal(request) or access.refusal(host, origin, token, cookie)
        if refusal:
            return web.Response(status=403, text=f"{refusal}\n")
        answer: web.StreamResponse = await handler(request)
        return answer

    async def _add_headers(self, request: web.Request, answer: web.StreamResponse) -> None:
        access = self._context.access
        for name, value in {**_HEADERS, **_policy(request, answer.status)}.items():
            answer.headers.setdefault(name, value)
        if answer.status < 400 and access.is_token(request.query.get("token")):
            # As a header: aiohttp has already written its cookies when this is called.
            cookie = f"{access.cookie_name}={access.cookie}; Path=/; HttpOnly; SameSite=Strict"
            answer.headers.add("Set-Cookie", cookie)

    async def _file(self, request: web.Request) -> web.Response:
        # Not a FileResponse: that logs a traceback where its connection is closed meanwhile.
        name = request.match_info.get("path", "index.html")
        if name not in self._files:
            raise web.HTTPNotFound(text="There is no such page.\n")
        kind = mimetypes.guess_type(name)[0] or "application/octet-stream"
        charset = "utf-8" if kind.startswith("text/") else None
        return web.Response(body=self._files[name], content_type=kind, charset=charset)

    async def _serve_page(self, request: web.Request) -> web.WebSocketResponse:
        socket = web.WebSocketResponse(heartbeat=_HEARTBEAT, max_msg_size=_MAX_MESSAGE)
        await socket.prepare(request)
        request[KEEP] = True
        page = _Page(socket, request.host, request.remote or "")
        self._make_room(page.peer)
        self._pages[socket] = page
        self._context.arbiter.join(page.name)
        sender = asyncio.ensure_future(self._send_states(page))
        lost = "it broke off"
        try:
            lost = await self._receive(page)
        except ConnectionError:
            pass  # the page was closed before it got a response
        finally:
            self._context.ended(lost, self._context.arbiter.leave(page.name))
            self._pages.pop(socket, None)
            sender.cancel()
        return socket

    def _make_room(self, peer: str) -> None:
        """Close the page that has been idle longest if there are too many, or of one computer."""
        driver = self._context.arbiter.state.driver
        crowds: dict[str, list[_Page]] = {}  # of those that do not drive
        for page in self._pages.values():
            if page.name != driver:
                crowds.setdefault(page.peer, []).append(page)
        if sum(page.peer == peer for page in self._pages.values()) >= _MOST_OF_A_PEER:
            crowd = crowds[peer]
        elif len(self._pages) >= _MAX_PAGES:
            crowd = max(crowds.values(), key=len)
        else:
            return
        idle = min(crowd, key=lambda page: page.active)
        del self._pages[idle.socket]
        reason = b"another page was opened"
        closing = idle.socket.close(code=GAVE_WAY, message=reason, drain=False)
        task = asyncio.ensure_future(closing)
        self._closing.add(task)
        task.add_done_callback(self._closing.discard)

    async def _receive(self, page: "_Page") -> str:
        """Handle a page's messages; return why its connection was lost, "" if it was closed."""
        while True:
            message = await page.socket.receive()
            if message.type in (WSMsgType.TEXT, WSMsgType.BINARY):
                page.active = time.monotonic()
                page.received += 1
                await self._on_message(
                    page, message.data if message.type == WSMsgType.TEXT else None
                )
            elif isinstance(message.data, WebSocketError):
                drove = self._context.arbiter.reject(page.name)
                self._context.rejected("too large, or no WebSocket frame", drove)
                return ""
            elif message.type in (WSMsgType.CLOSE, WSMsgType.CLOSING):
                return ""
            elif isinstance(page.socket.exception(), asyncio.TimeoutError):
                return "it does not respond"
            else:
                return "it broke off"

    async def _on_message(self, page: "_Page", text: str | None) -> None:
        context = self._context
        try:
            if text is None:
                raise ProtocolError("messages are text")
            message = parse(text)
        except ProtocolError as error:
            context.rejected(str(error), context.arbiter.reject(page.name))
            text = error_text(f"Refused: {error}.", error.about, error.field)
            await page.socket.send_str(text)
            return
        if isinstance(message, ChooseTopic):
            context.choose_topic(page.name, message.topic)
        else:
            context.arbiter.handle(page.name, message)

    async def _send_states(self, page: "_Page") -> None:
        """Send one page the state, ten times a second and whenever something changes."""
        try:
            stamp = stamp_of(time.monotonic())
            await page.socket.send_str(welcome_text(page.name, self._context.rate, stamp))
            while not page.socket.closed:
                page.changed.clear()
                while page.errors:
                    await page.socket.send_str(page.errors.popleft())
                await page.socket.send_str(state_text(self._state(page)))
                await asyncio.sleep(_MIN_PERIOD)
                try:
                    await asyncio.wait_for(page.changed.wait(), STATE_PERIOD - _MIN_PERIOD)
                except asyncio.TimeoutError:
                    pass
        except ConnectionError:
            pass  # the page was closed; the reader ends, too

    def _state(self, page: "_Page") -> dict[str, Any]:
        now, robot, view = (
            self._context.arbiter.state,
            self._context.robot(),
            self._context.view.view,
        )
        return {
            "stamp": stamp_of(time.monotonic()),
            "received": page.received,
            "late": page.name in now.late,
            "driver": now.driver,
            "you": now.driver == page.name,
            "pages": now.pages,
            "topic": robot.topic,
            "topic_type": robot.topic_type,
            "topics": robot.topics,
            "robots": [asdict(each) for each in robot.robots],
            "listeners": robot.listeners,
            "others": robot.others,
            "locked": robot.locked,
            "controllers": robot.controllers,
            **_limit_fields(now.limits),
            "braking": asdict(robot.braking) if robot.braking is not None else None,
            "command": velocity_fields(now.command),
            "odometry": robot.odometry,
            "camera": robot.camera,
            "obstacle": robot.obstacle,
            "view": view.addresses(page.host) if view is not None else None,
        }

    async def _close_pages(self, _: web.Application) -> None:
        for page in list(self._pages):
            await page.close(code=1001, message=b"the server is stopped")


def _limit_fields(limits: Limits) -> dict[str, Any]:
    linear, angular = limits.linear, limits.angular
    return {
        "limits": velocity_fields(limits.in_force),
        "chosen": asdict(limits.chosen),
        "ceiling": {"linear": linear.most, "angular": angular.most},
        "ceiling_from": {"linear": linear.source, "angular": angular.source},
    }


@dataclass
class _Page:
    socket: web.WebSocketResponse
    host: str  # of this server, as the browser has it
    peer: str  # the address of its computer
    active: float = field(default_factory=time.monotonic)  # when it was opened, or sent something
    name: str = field(default_factory=lambda: secrets.token_hex(4))
    received: int = 0  # messages
    changed: asyncio.Event = field(default_factory=asyncio.Event)
    errors: deque[str] = field(default_factory=deque)  # messages that are yet to be sent


def _policy(request: web.Request, status: int) -> dict[str, str]:
    # Some browsers do not count ws: as a part of 'self'. The guard has checked the host's form.
    socket = f" ws://{request.host}" if status < 400 else ""
    other = other_site(request.host) if status < 400 else ""
    view = f" http://{other}" if other else ""
    return {
        "Content-Security-Policy": "default-src 'self'; img-src 'self' data:; object-src 'none'; "
        "base-uri 'none'; form-action 'none'; frame-ancestors 'self'; "
        f"frame-src 'self'{view}; connect-src 'self'{socket}{view}"
    }
