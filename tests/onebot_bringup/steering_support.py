"""A page as the steering server sees it, and the server's node, for tests on real DDS."""

import asyncio
import json
import re
import socket
import threading
from collections.abc import Coroutine, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from typing import Any
from urllib.error import HTTPError
from urllib.parse import urlsplit
from urllib.request import Request, urlopen

import aiohttp
from geometry_msgs.msg import Twist

from tests.ros_support import NodeProcess, Peer, ros_args
from tests.support import PATIENCE, wait_for

MODULE = "onebot_bringup.steering.steering_page"
TOPIC = "/velocity_controller/cmd_vel"
BAD = b"\0\1\0\0\xff\xff\xff\xff\0\0\0\0"  # of no message: it has a text of 4 GB


class PageClient:
    """A WebSocket that says what it is told to, and keeps what it hears; use it as a context."""

    def __init__(self, address: str, **headers: str) -> None:
        self.states: list[dict[str, Any]] = []
        self.id = ""
        self.closed = False
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._loop.run_forever, daemon=True)
        self._thread.start()
        self._holding: Any = None
        self._do(self._open(f"{address.partition('/?')[0]}/ws", headers))
        wait_for(lambda: self.id and self.states, "the first state")

    def _do(self, action: Coroutine[Any, Any, Any]) -> Any:
        return asyncio.run_coroutine_threadsafe(action, self._loop).result(PATIENCE)

    async def _open(self, address: str, headers: dict[str, str]) -> None:
        self._session = aiohttp.ClientSession()
        try:
            self._socket = await self._session.ws_connect(address, headers=headers)
        except aiohttp.ClientError:
            await self._session.close()
            raise
        self._hearing = asyncio.ensure_future(self._hear())

    async def _hear(self) -> None:
        async for message in self._socket:
            fields = json.loads(message.data)
            if fields["type"] == "welcome":
                self.id = fields["id"]
            elif fields["type"] == "state":
                self.states.append(fields)
        self.closed = True

    @property
    def state(self) -> dict[str, Any]:
        """The latest."""
        return self.states[-1]

    def say(self, text: str) -> None:
        """Send text as it is."""
        self._do(self._socket.send_str(text))

    def send(self, kind: str, **fields: Any) -> None:
        """Send a message."""
        self.say(json.dumps({"type": kind, **fields}))

    def hold(
        self, linear: float, angular: float = 0.0, lateral: float = 0.0, **joints: float
    ) -> None:
        """Drive until told otherwise, as a page does while something is held."""
        self.silence()
        speeds = {"linear": linear, "angular": angular, "lateral": lateral}
        fields = {"type": "drive", **speeds, "joints": joints}
        self._holding = asyncio.run_coroutine_threadsafe(self._hold(fields), self._loop)

    async def _hold(self, fields: Mapping[str, Any]) -> None:
        while True:
            await self._socket.send_str(json.dumps({**fields, "stamp": self.state["stamp"]}))
            await asyncio.sleep(0.05)

    def silence(self) -> None:
        """Say nothing any more, without having let go."""
        if self._holding is not None:
            self._holding.cancel()
            self._holding = None

    def let_go(self) -> None:
        """Let go of what is held."""
        self.silence()
        self.send("release")

    def cut(self) -> None:
        """Lose the connection without a word, as a browser that is killed."""
        self.silence()

        async def shut_down() -> None:
            self._socket.get_extra_info("socket").shutdown(socket.SHUT_RDWR)

        self._do(shut_down())

    def close(self) -> None:
        """Close the tab."""
        self.silence()
        self._do(self._shut())
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join(PATIENCE)

    async def _shut(self) -> None:
        await self._socket.close()
        await self._session.close()
        self._hearing.cancel()

    def __enter__(self) -> "PageClient":
        return self

    def __exit__(self, *_: object) -> None:
        if self._thread.is_alive():
            self.close()


class Way:
    """A proxy in front of the server, as an SSH tunnel: it can be slow on the way to it, or cut."""

    def __init__(self, address: str) -> None:
        self.delay = 0.0  # s
        self._server = urlsplit(address)
        self._open: set[asyncio.StreamWriter] = set()
        self._loop = asyncio.new_event_loop()
        threading.Thread(target=self._loop.run_forever, daemon=True).start()
        self._listening = self._do(asyncio.start_server(self._serve, "127.0.0.1", 0))
        self.port = self._listening.sockets[0].getsockname()[1]
        self.address = f"http://127.0.0.1:{self.port}"

    def _do(self, action: Coroutine[Any, Any, Any]) -> Any:
        return asyncio.run_coroutine_threadsafe(action, self._loop).result(PATIENCE)

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        # By 127.0.0.1, also where the server is reached at another address of this computer.
        answers, onward = await asyncio.open_connection("127.0.0.1", self._server.port)
        ends = {writer, onward}
        self._open |= ends
        with suppress(ConnectionError):
            await asyncio.gather(self._pass(reader, onward, True), self._pass(answers, writer))
        self._open -= ends

    async def _pass(
        self, source: asyncio.StreamReader, target: asyncio.StreamWriter, slow: bool = False
    ) -> None:
        while data := await source.read(1 << 16):
            if slow:
                await asyncio.sleep(self.delay)  # what comes meanwhile is read at once
            target.write(data)
            await target.drain()
        target.close()

    def cut(self) -> None:
        """End all connections; new ones are accepted."""
        self._do(self._cut())

    async def _cut(self) -> None:
        for writer in self._open:
            writer.transport.abort()
        tasks = asyncio.all_tasks() - {asyncio.current_task()}
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        self._open.clear()

    def __enter__(self) -> "Way":
        return self

    def __exit__(self, *_: object) -> None:
        self._loop.call_soon_threadsafe(self._listening.close)  # else the page comes again
        self.cut()
        self._loop.call_soon_threadsafe(self._loop.stop)


class Steering(NodeProcess):
    """The node, on any free port."""

    def __init__(self, check: bool = True, **parameters: object) -> None:
        args = ros_args(**{"port": 0, "open_browser": "false", **parameters})
        super().__init__(MODULE, *args, check=check)

    @property
    def address(self) -> str:
        """What it prints."""

        def printed() -> re.Match[str] | None:
            match = re.search(r"open (http://\S+)\n", self.output)
            assert match or self.process.poll() is None, self.output
            return match

        found = wait_for(printed, "the page's address")
        assert found is not None
        return found[1]

    @property
    def port(self) -> int:
        return urlsplit(self.address).port or 0


@contextmanager
def steering(check: bool = True, **parameters: object) -> Iterator[Steering]:
    """The node, once it serves."""
    with Steering(check, **parameters) as node:
        assert node.address
        yield node


@contextmanager
def steered(pages: int = 1, /, **parameters: object) -> Iterator[tuple[Any, ...]]:
    """The node as ``steering`` has it, and its first pages, once they are told of the robot."""
    with steering(**parameters) as node, ExitStack() as opened:
        address = node.address
        yield node, *(opened.enter_context(PageClient(address)) for _ in range(pages))


@contextmanager
def visited(domain: int, node: Steering, pages: int = 1) -> Iterator[tuple[Any, ...]]:
    """A peer of a node that tests share, and the node's pages, once they are told of the robot."""
    with Peer(domain) as peer, ExitStack() as opened:
        yield peer, *(opened.enter_context(PageClient(node.address)) for _ in range(pages))


def requested(request: Request) -> Any:
    """The answer to a request, a refusal too; use it as a context."""
    try:
        return urlopen(request, timeout=PATIENCE)
    except HTTPError as error:
        return error


def cookie_of(address: str) -> str:
    """The cookie that a page gets at an address with its token."""
    with urlopen(address, timeout=PATIENCE) as answer:
        return str(answer.headers["Set-Cookie"])


class Commands:
    """What a robot hears on its topic."""

    def __init__(self, peer: Peer, page: PageClient, topic: str = TOPIC, kind: Any = Twist) -> None:
        self.heard = peer.hear(kind, topic)
        wait_for(lambda: page.state["listeners"] and page.state["topic"] == topic, "the robot")

    @property
    def moving(self) -> list[Any]:
        """All messages but the zeros, which also bridge a moment in which a busy page is late."""
        twists = [getattr(message, "twist", message) for message in self.heard]
        return [twist for twist in twists if twist != Twist()]

    @property
    def speeds(self) -> list[float]:
        """All linear velocities so far, m/s."""
        return [getattr(message, "twist", message).linear.x for message in self.heard]

    def come_to_rest(self) -> None:
        """Wait until the last commands are the zeros that stop it, and there are no others."""
        wait_for(lambda: len(self.speeds) > 3 and self.speeds[-3:] == [0.0] * 3, "three zeros")

    def reach(self, speed: float) -> None:
        """Wait for a command of that speed."""
        wait_for(lambda: speed in self.speeds, f"a command of {speed} m/s")
