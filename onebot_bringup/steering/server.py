"""The steering page's server: the page, its WebSocket and the robot's view on one port."""

import asyncio
import secrets
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from aiohttp import WSMsgType, web

from onebot_bringup.steering.access import Access, other_site
from onebot_bringup.steering.arbiter import ThreadSafeArbiter
from onebot_bringup.steering.protocol import (
    ChooseTopic,
    ProtocolError,
    error_text,
    parse,
    state_text,
    velocity_fields,
    welcome_text,
)
from onebot_bringup.steering.view_proxy import ViewProxy

STATIC = Path(__file__).parent / "static"
STATE_PERIOD = 0.1  # s
_MIN_PERIOD = 0.02  # s between two states, even if more changes
_HEARTBEAT = 5.0  # s between two pings; a page that does not respond counts as closed
_MAX_MESSAGE = 1 << 16  # bytes; beyond it the connection is closed
_MAX_PAGES = 64
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
    listeners: int = 0  # the number of subscribers
    odometry: Mapping[str, Any] | None = None  # its fields in the state


@dataclass
class ServerContext:
    """What the server needs of the node."""

    arbiter: ThreadSafeArbiter
    access: Access
    view: ViewProxy
    robot: Callable[[], RobotStatus]
    # Called with the name of a page and of the topic that it chose; ``SteeringServer.show_error``
    # replies to that page if the topic cannot be used.
    choose_topic: Callable[[str, str], None]
    report: Callable[[str], None]  # called with the problem of each rejected message
    rate: float  # of commands, Hz


class SteeringServer:
    """The aiohttp application."""

    def __init__(self, context: ServerContext) -> None:
        """Make the application, ``app``."""
        self._context = context
        self._pages: dict[web.WebSocketResponse, _Page] = {}
        self.app = web.Application(middlewares=[self._guard], client_max_size=_MAX_MESSAGE)
        self.app.on_response_prepare.append(self._add_headers)
        self.app.on_shutdown.append(self._close_pages)
        self.app.router.add_get("/", self._index)
        self.app.router.add_get("/ws", self._serve_page)
        self.app.router.add_static("/static", STATIC)
        context.view.add_to(self.app)

    def notify(self) -> None:
        """Send all pages the state now; to be called in the server's thread."""
        for page in self._pages.values():
            page.changed.set()

    def show_error(self, name: str, sentence: str) -> None:
        """Send one page an error message; to be called in the server's thread."""
        for page in self._pages.values():
            if page.name == name:
                page.errors.append(sentence)
                page.changed.set()

    @web.middleware
    async def _guard(self, request: web.Request, handler: Any) -> web.StreamResponse:
        access = self._context.access
        host, origin = request.headers.get("Host", ""), request.headers.get("Origin")
        if self._context.view.has_key(request):
            refusal = access.view_refusal(host, origin)
        else:
            token, cookie = request.query.get("token"), request.cookies.get(access.cookie_name)
            refusal = access.refusal(host, origin, token, cookie)
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

    async def _index(self, _: web.Request) -> web.FileResponse:
        return web.FileResponse(STATIC / "index.html")

    async def _serve_page(self, request: web.Request) -> web.WebSocketResponse:
        if len(self._pages) >= _MAX_PAGES:
            raise web.HTTPServiceUnavailable(text="There are too many pages open.\n")
        socket = web.WebSocketResponse(heartbeat=_HEARTBEAT, max_msg_size=_MAX_MESSAGE)
        await socket.prepare(request)
        page = _Page(socket, request.host)
        self._pages[socket] = page
        self._context.arbiter.join(page.name)
        sender = asyncio.ensure_future(self._send_states(page))
        try:
            async for message in socket:
                if message.type == WSMsgType.ERROR:
                    self._context.report("too large, or no WebSocket frame")
                    break
                await self._on_message(
                    page, message.data if message.type == WSMsgType.TEXT else None
                )
        except ConnectionError:
            pass  # the page was closed before it got a response
        finally:
            self._context.arbiter.leave(page.name)
            self._pages.pop(socket, None)
            sender.cancel()
        return socket

    async def _on_message(self, page: "_Page", text: str | None) -> None:
        context = self._context
        try:
            if text is None:
                raise ProtocolError("messages are text")
            message = parse(text)
        except ProtocolError as error:
            context.arbiter.reject(page.name)
            context.report(str(error))
            await page.socket.send_str(error_text(f"Refused: {error}."))
            return
        if isinstance(message, ChooseTopic):
            context.choose_topic(page.name, message.topic)
        else:
            context.arbiter.handle(page.name, message)

    async def _send_states(self, page: "_Page") -> None:
        """Send one page the state, ten times a second and whenever something changes."""
        try:
            await page.socket.send_str(welcome_text(page.name, self._context.rate))
            while not page.socket.closed:
                page.changed.clear()
                while page.errors:
                    await page.socket.send_str(error_text(page.errors.popleft()))
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
            "driver": now.driver,
            "you": now.driver == page.name,
            "pages": now.pages,
            "topic": robot.topic,
            "topic_type": robot.topic_type,
            "topics": robot.topics,
            "listeners": robot.listeners,
            "limits": velocity_fields(now.limits),
            "command": velocity_fields(now.command),
            "odometry": robot.odometry,
            "view": view.addresses(page.host) if view is not None else None,
        }

    async def _close_pages(self, _: web.Application) -> None:
        for page in list(self._pages):
            await page.close(code=1001, message=b"the server is stopped")


@dataclass
class _Page:
    socket: web.WebSocketResponse
    host: str  # of this server, as the browser has it
    name: str = field(default_factory=lambda: secrets.token_hex(4))
    changed: asyncio.Event = field(default_factory=asyncio.Event)
    errors: deque[str] = field(default_factory=deque)


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
