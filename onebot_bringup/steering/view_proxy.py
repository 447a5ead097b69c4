"""Serves the robot's view, Rerun's page and its data, through a proxy on the steering page's port.

The view is slow if a browser draws without a graphics card, and must not stall the steering page.
It is therefore a sandboxed frame with an opaque origin, which Chromium runs in a separate process.
On loopback its address also has the other one of the names 127.0.0.1 and localhost: that makes it
another site, which other browsers run in a separate process, too.

Such a frame has no cookies. All its requests are below a path with a random key, which only the
steering page gets. Rerun requests data from
``/rerun.sdk_comms.v1alpha1.MessageProxyService/...`` on the host and port in its page's ``url=``
parameter; ``static/view_frame.js`` runs in the frame and redirects these requests to that path.
"""

import hmac
import json
import re
import secrets
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from urllib.parse import quote

from aiohttp import web
from rclpy.node import Node
from std_msgs.msg import String

from onebot_bringup.serving.rerun_messages import SERVICE
from onebot_bringup.serving.rerun_proxy import RerunProxy, content_policy, data_url
from onebot_bringup.steering.access import other_site
from onebot_description.ros.topic_qos import LATCHED
from onebot_description.timing.throttled import Throttled

Row = Mapping[str, Any]
_SANDBOX = "allow-scripts allow-downloads allow-popups allow-popups-to-escape-sandbox"
_POLICY = f"{content_policy()}; base-uri 'none'; form-action 'none'; sandbox {_SANDBOX}"
_SCRIPT = Path(__file__).parent / "static" / "view_frame.js"
_PAGE = re.compile(r"http://127\.0\.0\.1:(\d{1,5})/\?(\S+)")


@dataclass(frozen=True)
class View:
    """The address of a viewer's page on this computer."""

    port: int  # the port of the page and its data on 127.0.0.1
    options: tuple[str, ...] = ()  # the parameters of the page's address besides url=
    # Required in the path of the view's requests. Each viewer has its own key: when it changes, a
    # page reloads the view.
    key: str = field(default_factory=lambda: secrets.token_urlsafe(16))

    @classmethod
    def parse(cls, address: str) -> "View | None":
        """Parse a message of rerun_viewer's ~/page; None if the page is not on this computer."""
        page = _PAGE.fullmatch(address)
        if page is None or not 0 < int(page[1]) < 65536:
            return None
        words = page[2].split("&")
        return cls(int(page[1]), tuple(word for word in words if not word.startswith("url=")))

    def addresses(self, host: str) -> list[str]:
        """Return the view's addresses, best first, for a page opened at ``host``."""
        return [self._address(name, host) for name in (other_site(host), host) if name]

    def _address(self, host: str, page: str) -> str:
        words = data_url(host), *self.options, f"page={quote(f'http://{page}', safe=':/[]')}"
        return f"http://{host}/view/{self.key}/?{'&'.join(words)}"


class Viewer:
    """Follows the node that shows the robot.

    Attributes:
        view: the address of its page; None if there is none.
    """

    def __init__(self, node: Node, page_topic: str) -> None:
        """Follow its ~/page and ~/displays."""
        self._node, self._topic = node, page_topic
        self._warn = Throttled(node.get_logger().warning)
        self._name = page_topic.rpartition("/")[0]
        self._shown: list[Row] = []
        self._legend: list[Row] = []
        self.view: View | None = None
        self._cameras = node.create_publisher(String, f"{self._name}/page_cameras", LATCHED)
        self._published_cameras = ""
        node.create_subscription(String, page_topic, self._on_page, LATCHED)
        node.create_subscription(String, f"{self._name}/displays", self._on_displays, LATCHED)

    def update(self) -> None:
        """Notice if the viewer is gone; call this several times per second."""
        if self.view is not None and not self._node.count_publishers(self._topic):
            self.view = None

    def publish_cameras(self, topics: Sequence[str]) -> None:
        """Publish which cameras' pictures the page shows, so that the view leaves them out."""
        cameras = json.dumps({"cameras": topics})
        if cameras != self._published_cameras:
            self._published_cameras = cameras
            self._cameras.publish(String(data=cameras))

    def fields(self) -> Mapping[str, Any]:
        """Return the viewer's name, "" for none, and the topics that it shows."""
        if self.view is None:
            return {"viewer": "", "shown": []}
        return {"viewer": self._name, "shown": self._shown}

    @property
    def legend(self) -> list[Row]:
        """The trails and covariances in the view: ``kind``, ``name`` and CSS ``color`` of each."""
        return self._legend if self.view is not None else []

    def _on_page(self, message: String) -> None:
        self.view = View.parse(message.data)
        if message.data and self.view is None:
            self._warn("page", f"{self._topic} has no address of a page on this computer")

    def _on_displays(self, message: String) -> None:
        self._shown, self._legend = parse_displays(message.data)


def parse_displays(data: str) -> tuple[list[Row], list[Row]]:
    """Parse a viewer's ~/displays; return the parts that a page needs, empty if invalid.

    Returns:
        The topics that it shows, and its legend, with colors as in CSS.
    """
    try:
        displays = json.loads(data)
        legend: list[Row] = [
            {**entry, "color": "#{:02x}{:02x}{:02x}".format(*entry["color"])}
            for entry in displays["legend"]
        ]
        return list(displays["shown"]), legend
    except (ValueError, LookupError, TypeError, RecursionError):
        return [], []


class ViewProxy:
    """The routes of the robot's view."""

    def __init__(self, viewer: Viewer) -> None:
        self.viewer = viewer

    def add_to(self, app: web.Application) -> None:
        unavailable = "The robot's view is not answering."
        self._proxy = RerunProxy(app, _POLICY, unavailable, _SCRIPT.read_text())
        app.on_response_prepare.append(self._add_headers)
        app.router.add_post(f"/view/{{key}}/{SERVICE}/{{method}}", self._data)
        app.router.add_options(f"/view/{{key}}/{SERVICE}/{{method}}", self._preflight)
        app.router.add_get("/view/{key}/{path:.*}", self._page)

    def has_key(self, request: web.Request) -> bool:
        """Whether the request's path has the view's key."""
        key = request.match_info.get("key", "").encode(errors="surrogatepass")
        view = self.viewer.view
        return view is not None and hmac.compare_digest(key, view.key.encode())

    async def _page(self, request: web.Request) -> web.StreamResponse:
        view = self._view_of(request)
        path = request.rel_url.raw_path_qs.split("/", 3)[3]
        return await self._proxy.forward_page(request, view.port, f"/{path}")

    async def _data(self, request: web.Request) -> web.StreamResponse:
        view, method = self._view_of(request), request.match_info["method"]
        return await self._proxy.forward_data(request, view.port, f"/{SERVICE}/{method}")

    async def _preflight(self, request: web.Request) -> web.StreamResponse:
        self._view_of(request)
        headers = {"Access-Control-Allow-Headers": "*", "Access-Control-Allow-Methods": "POST"}
        return web.Response(status=204, headers=headers)

    async def _add_headers(self, request: web.Request, answer: web.StreamResponse) -> None:
        """Let the frame read the response, and only the steering page embed the frame."""
        if not self.has_key(request):
            return
        other_host = other_site(request.host)
        pages = f"'self' http://{other_host}" if other_host else "'self'"
        answer.headers.add("Content-Security-Policy", f"frame-ancestors {pages}")
        answer.headers["Cross-Origin-Resource-Policy"] = "cross-origin"
        # The guard has already checked the origin.
        answer.headers["Access-Control-Allow-Origin"] = request.headers.get("Origin", "null")
        answer.headers["Access-Control-Expose-Headers"] = "*"

    def _view_of(self, request: web.Request) -> View:
        view = self.viewer.view
        if view is None or not self.has_key(request):
            raise web.HTTPNotFound(text="There is no such view of the robot.\n")
        return view
