"""The steering page's server: the page, its WebSocket and the robot's view on one port."""

import asyncio
import contextlib
import secrets
import socket
import threading
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from aiohttp import WSMsgType, web

from onebot_bringup.steering.access import Access
from onebot_bringup.steering.arbiter import Helm
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

# How the page is served: a thread that answers on a socket.

_PATIENCE = 0.5  # s for what is being answered when the server stops


class ServerThread:
    """Serves an application until it is stopped."""

    def __init__(self, app: web.Application, listener: socket.socket) -> None:
        """Start."""
        self._app, self._listener = app, listener
        self._end = asyncio.Event()
        self._running = threading.Event()
        self._thread = threading.Thread(
            target=lambda: asyncio.run(self._serve()), name="steering", daemon=True
        )
        self._thread.start()
        self._running.wait()

    def call(self, action: Callable[[], None]) -> None:
        """Have something done in the server's thread, soon; not once it is stopped."""
        with contextlib.suppress(RuntimeError):
            self._loop.call_soon_threadsafe(action)

    def stop(self) -> None:
        """Close all connections and the socket."""
        self.call(self._end.set)
        self._thread.join(4 * _PATIENCE)

    async def _serve(self) -> None:
        self._loop = asyncio.get_running_loop()
        self._running.set()
        runner = web.AppRunner(
            self._app, access_log=None, handle_signals=False, shutdown_timeout=_PATIENCE
        )
        await runner.setup()
        await web.SockSite(runner, self._listener).start()
        await self._end.wait()
        await runner.cleanup()


STATIC = Path(__file__).parent / "static"
STATE_PERIOD = 0.1  # s
_SHORTEST = 0.02  # s between two states, whatever changes
_HEARTBEAT = 5.0  # s between two pings; a page that does not answer is taken for closed
_LARGEST = 1 << 16  # bytes; beyond it the connection is closed
_MOST_PAGES = 64
_NEVER_CHANGING = {
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cache-Control": "no-cache",
}


@dataclass(frozen=True)
class Robot:
    """What pages are told about the robot.

    Attributes:
        topic: the one that is steered, in full.
        topic_type: its type, such as geometry_msgs/msg/Twist.
        topics: those that could be, the ones with subscribers first.
        listeners: how many robots subscribe to it.
        odometry: its fields in the state, None while there is none.
    """

    topic: str
    topic_type: str = "geometry_msgs/msg/Twist"
    topics: tuple[str, ...] = ()
    listeners: int = 0
    odometry: Mapping[str, Any] | None = None


@dataclass
class Cockpit:
    """What the server needs to know; ``robot`` may be replaced at any time, on any thread.

    Attributes:
        helm: who drives.
        access: who may.
        view: the way to the robot's view.
        robot: what is known about it.
        choose_topic: called with the name of a page and that of the topic that it wants to steer;
            ``SteeringServer.refuse`` tells it if it cannot.
        warn: called with the reason of every message that was refused.
        rate: of the commands, Hz.
    """

    helm: Helm
    access: Access
    view: ViewProxy
    robot: Callable[[], Robot]
    choose_topic: Callable[[str, str], None]
    warn: Callable[[str], None]
    rate: float


class SteeringServer:
    """The aiohttp application."""

    def __init__(self, cockpit: Cockpit) -> None:
        """Make the application, ``app``."""
        self._cockpit = cockpit
        self._pages: dict[web.WebSocketResponse, _Page] = {}
        self.app = web.Application(middlewares=[self._guard], client_max_size=_LARGEST)
        self.app.on_response_prepare.append(self._add_headers)
        self.app.on_shutdown.append(self._close_pages)
        self.app.router.add_get("/", self._index)
        self.app.router.add_get("/ws", self._talk)
        self.app.router.add_static("/static", STATIC)
        cockpit.view.add_to(self.app)

    def tell(self) -> None:
        """Send all pages the state now; to be called in the server's own thread."""
        for page in self._pages.values():
            page.news.set()

    def refuse(self, name: str, sentence: str) -> None:
        """Tell one page why nothing came of its wish; to be called in the server's own thread."""
        for page in self._pages.values():
            if page.name == name:
                page.refusals.append(sentence)
                page.news.set()

    # --- who may --------------------------------------------------------------------------------

    @web.middleware
    async def _guard(self, request: web.Request, handler: Any) -> web.StreamResponse:
        access = self._cockpit.access
        refusal = access.refusal(
            request.headers.get("Host", ""),
            request.headers.get("Origin"),
            request.query.get("token"),
            request.cookies.get(access.cookie_name),
        )
        if refusal:
            return web.Response(status=403, text=f"{refusal}\n")
        answer: web.StreamResponse = await handler(request)
        return answer

    async def _add_headers(self, request: web.Request, answer: web.StreamResponse) -> None:
        access = self._cockpit.access
        for name, value in {**_NEVER_CHANGING, **_policy(request, answer.status)}.items():
            answer.headers.setdefault(name, value)
        if answer.status < 400 and access.is_token(request.query.get("token")):
            # By hand: when this is called, aiohttp has written out its cookies already.
            cookie = f"{access.cookie_name}={access.cookie}; Path=/; HttpOnly; SameSite=Strict"
            answer.headers.add("Set-Cookie", cookie)

    # --- pages ----------------------------------------------------------------------------------

    async def _index(self, _: web.Request) -> web.FileResponse:
        return web.FileResponse(STATIC / "index.html")

    async def _talk(self, request: web.Request) -> web.WebSocketResponse:
        if len(self._pages) >= _MOST_PAGES:
            raise web.HTTPServiceUnavailable(text="There are too many pages open.\n")
        socket = web.WebSocketResponse(heartbeat=_HEARTBEAT, max_msg_size=_LARGEST)
        await socket.prepare(request)
        page = _Page(socket, request.host)
        self._pages[socket] = page
        self._cockpit.helm.join(page.name)
        sender = asyncio.ensure_future(self._keep_telling(page))
        try:
            async for message in socket:
                if message.type == WSMsgType.ERROR:
                    self._cockpit.warn("too large, or no WebSocket frame")
                    break
                await self._hear(page, message.data if message.type == WSMsgType.TEXT else None)
        except ConnectionError:
            pass  # the page left before it got an answer
        finally:
            self._cockpit.helm.leave(page.name)
            self._pages.pop(socket, None)
            sender.cancel()
        return socket

    async def _hear(self, page: "_Page", text: str | None) -> None:
        cockpit = self._cockpit
        try:
            if text is None:
                raise ProtocolError("messages are text")
            message = parse(text)
        except ProtocolError as error:
            cockpit.helm.refuse(page.name)
            cockpit.warn(str(error))
            await page.socket.send_str(error_text(f"Refused: {error}."))
            return
        if isinstance(message, ChooseTopic):
            cockpit.choose_topic(page.name, message.topic)
        else:
            cockpit.helm.take(page.name, message)

    async def _keep_telling(self, page: "_Page") -> None:
        """Send one page the state, ten times a second and whenever something changes."""
        try:
            await page.socket.send_str(welcome_text(page.name, self._cockpit.rate))
            while not page.socket.closed:
                page.news.clear()
                while page.refusals:
                    await page.socket.send_str(error_text(page.refusals.popleft()))
                await page.socket.send_str(state_text(self._state(page)))
                await asyncio.sleep(_SHORTEST)
                try:
                    await asyncio.wait_for(page.news.wait(), STATE_PERIOD - _SHORTEST)
                except asyncio.TimeoutError:
                    pass
        except ConnectionError:
            pass  # the page is gone, as the other end will notice

    def _state(self, page: "_Page") -> dict[str, Any]:
        now, robot, view = self._cockpit.helm.now, self._cockpit.robot(), self._cockpit.view.view
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
            "view": view.path(page.host) if view is not None else None,
        }

    async def _close_pages(self, _: web.Application) -> None:
        for page in list(self._pages):
            await page.close(code=1001, message=b"the server is stopped")


@dataclass
class _Page:
    socket: web.WebSocketResponse
    host: str  # the name that the browser knows this server by
    name: str = field(default_factory=lambda: secrets.token_hex(4))
    news: asyncio.Event = field(default_factory=asyncio.Event)
    refusals: deque[str] = field(default_factory=deque)


def _policy(request: web.Request, status: int) -> dict[str, str]:
    # Some browsers do not take ws: for a part of 'self'. The guard has checked the host's form.
    socket = f" ws://{request.host}" if status < 400 else ""
    return {
        "Content-Security-Policy": "default-src 'self'; img-src 'self' data:; object-src 'none'; "
        "base-uri 'none'; form-action 'none'; frame-ancestors 'self'; "
        f"connect-src 'self'{socket}"
    }
