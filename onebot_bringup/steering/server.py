"""The steering page's server: the page, its WebSocket and the robot's view on one port."""

import asyncio
import secrets
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from aiohttp import WSMsgType, web
from rclpy.impl.rcutils_logger import RcutilsLogger

from onebot_bringup.serving.origin import foreign_refusal
from onebot_bringup.steering.access import Access, other_site
from onebot_bringup.steering.arbiter import Arbiter
from onebot_bringup.steering.protocol import ChooseTopic, ProtocolError, message_text, parse
from onebot_bringup.steering.tool_requests import ToolRequests
from onebot_bringup.steering.view_proxy import ViewProxy
from onebot_description.errors import OneBotError
from onebot_description.timing.throttled import Throttled
from onebot_description.timing.wake_detector import boot_time

STATIC = Path(__file__).parent / "static"
STATE_PERIOD = 0.1  # s
_HEARTBEAT = 5.0  # s between two pings; a page that does not respond counts as closed
_MAX_MESSAGE = 1 << 16  # bytes; a longer message closes the connection
_STOPPED = "; it drove, so the robot is stopped"
_HEADERS = {
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cache-Control": "no-cache",
}


@dataclass(eq=False)
class _Page:
    socket: web.WebSocketResponse
    host: str  # the name by which the browser addresses this server
    name: str = field(default_factory=lambda: secrets.token_hex(4))
    received: int = 0  # number of messages


@dataclass(eq=False)
class SteeringServer:
    """The aiohttp application with the page, its WebSocket and the robot's view."""

    arbiter: Arbiter
    access: Access
    view: ViewProxy
    tools: ToolRequests
    robot: Callable[[], Mapping[str, Any]]  # returns the node's part of a page's state
    choose_topic: Callable[[str], None]  # blocks; raises a OneBotError if it cannot be used
    logger: RcutilsLogger

    def __post_init__(self) -> None:
        """Make the application."""
        self._pages: list[_Page] = []
        self._warn = Throttled(self.logger.warning)
        self.app = web.Application(middlewares=[self._guard], client_max_size=_MAX_MESSAGE)
        self.app.on_response_prepare.append(self._add_headers)
        self.app.on_shutdown.append(self._close_pages)
        self.app.router.add_get("/", self._get_index)
        self.app.router.add_get("/ws", self._serve_page)
        self.app.router.add_static("/static", STATIC, follow_symlinks=True)  # colcon's
        self.view.add_to(self.app)
        self.app.add_routes(self.tools.routes())

    @web.middleware
    async def _guard(self, request: web.Request, handler: Any) -> web.StreamResponse:
        access = self.access
        host, origin = request.headers.get("Host", ""), request.headers.get("Origin")
        if self.view.has_key(request):
            refusal = access.view_refusal(host, origin)
        else:
            token, cookie = request.query.get("token"), request.cookies.get(access.cookie_name)
            refusal = foreign_refusal(request) or access.refusal(host, origin, token, cookie)
        if refusal:
            return web.Response(status=403, text=f"{refusal}\n")
        answer: web.StreamResponse = await handler(request)
        return answer

    async def _add_headers(self, request: web.Request, answer: web.StreamResponse) -> None:
        access = self.access
        for name, value in {**_HEADERS, **_policy(request, answer.status)}.items():
            answer.headers.setdefault(name, value)
        if answer.status < 400 and access.is_token(request.query.get("token")):
            # Set it as a header, since aiohttp has already written its cookies at this point.
            cookie = f"{access.cookie_name}={access.cookie}; Path=/; HttpOnly; SameSite=Strict"
            answer.headers.add("Set-Cookie", cookie)

    async def _get_index(self, _: web.Request) -> web.FileResponse:
        return web.FileResponse(STATIC / "index.html")

    async def _serve_page(self, request: web.Request) -> web.WebSocketResponse:
        socket = web.WebSocketResponse(heartbeat=_HEARTBEAT, max_msg_size=_MAX_MESSAGE)
        await socket.prepare(request)
        page = _Page(socket, request.host)
        self._pages.append(page)
        self.arbiter.join(page.name)
        sender = asyncio.ensure_future(self._send_states(page))
        try:
            async for message in socket:
                if message.type in (WSMsgType.TEXT, WSMsgType.BINARY):
                    page.received += 1
                    await self._on_message(page, message.data)
                elif message.type == WSMsgType.ERROR:
                    self._warn("frame", "rejected a message: too large, or not a WebSocket frame")
        except ConnectionError:
            pass  # the page was closed before it got a response
        finally:
            drove = self.arbiter.leave(page.name)
            self.logger.info(f"a page was closed, or its connection was lost{_STOPPED * drove}")
            self._pages.remove(page)
            sender.cancel()
        return socket

    async def _on_message(self, page: _Page, data: str | bytes) -> None:
        try:
            message = parse(data)
        except ProtocolError as error:
            drove = self.arbiter.reject(page.name)
            self._warn(str(error), f"rejected a message of a page: {error}{_STOPPED * drove}")
            await _send_error(page, f"Rejected: {error}.", error.about)
            return
        if not isinstance(message, ChooseTopic):
            self.arbiter.handle(page.name, message)
            return
        try:
            await asyncio.to_thread(self.choose_topic, message.topic)
        except OneBotError as error:
            await _send_error(page, f"{error}.", "topic")

    async def _send_states(self, page: _Page) -> None:
        """Send the state to one page, ten times a second."""
        send = page.socket.send_str
        try:
            await send(message_text("welcome", id=page.name, stamp=boot_time()))
            while not page.socket.closed:
                await send(message_text("state", **self._state(page)))
                await asyncio.sleep(STATE_PERIOD)
        except ConnectionError:
            pass  # the page was closed, so the reader ends, too

    def _state(self, page: _Page) -> dict[str, Any]:
        arbiter, view = self.arbiter.state, self.view.viewer.view
        limits = arbiter.limits
        return {
            "stamp": boot_time(),  # s; a page returns it in its next messages
            "received": page.received,  # number of messages from this page
            "late": page.name in arbiter.late,  # whether its commands are too old to drive
            "driver": arbiter.driver,  # the name of the page that drives
            "you": arbiter.driver == page.name,
            "pages": arbiter.pages,
            **self.robot(),
            "limits": limits.in_force._asdict(),
            "chosen": asdict(limits.chosen),
            "ceiling": {axis: bound.forward for axis, bound in limits.bounds.items()},
            "ceiling_from": {axis: bound.source for axis, bound in limits.bounds.items()},
            "minimum_radius": limits.minimum_radius,  # m; 0: the robot turns on the spot
            "command": {**arbiter.command.velocity._asdict(), "joints": arbiter.command.joints},
            "view": view.addresses(page.host) if view is not None else None,
        }

    async def _close_pages(self, _: web.Application) -> None:
        for page in list(self._pages):
            await page.socket.close(code=1001, message=b"the server is stopped")


async def _send_error(page: _Page, sentence: str, about: str | None) -> None:
    await page.socket.send_str(message_text("error", message=sentence, about=about))


def _policy(request: web.Request, status: int) -> dict[str, str]:
    other_host = other_site(request.host) if status < 400 else ""
    view = f" http://{other_host}" if other_host else ""
    return {
        "Content-Security-Policy": "default-src 'self'; img-src 'self' data:; object-src 'none'; "
        "base-uri 'none'; form-action 'none'; frame-ancestors 'self'; "
        f"frame-src 'self'{view}; connect-src 'self'{view}"
    }
