"""Rerun's page, passed on with an order to the browser: stay on this machine.

Rerun's own server hosts the page, whose code reports usage, looks for updates and fetches fonts,
and has no switch for that (``&notebook=1`` does not stop it in 0.41). A browser obeys a Content
Security Policy, so this small proxy adds one. It also gives the page a short address.
"""

import http.client
import re
import threading
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

from onebot_bringup.viewer.processes import LOOPBACK

POLICY = (
    "default-src 'self' 'unsafe-inline' 'unsafe-eval' data: blob:; "
    "connect-src 'self' http://127.0.0.1:* http://localhost:* data: blob:"
)
_CHUNK = 1 << 16
_FOREIGN_LINK = re.compile(rb"<link[^>]*https?://[^>]*>")
_PASSED_ON = ("Content-Type", "Content-Length", "Content-Encoding", "rerun-final-length")


class PageServer:
    """Serves the page at 127.0.0.1:``port`` from Rerun's server at ``backend_port``."""

    def __init__(self, port: int, backend_port: int, start: str) -> None:
        """Listen and serve, in threads of its own.

        Args:
            port: where browsers come.
            backend_port: where Rerun's server listens, on this host.
            start: path and query that the bare address leads to.
        """
        handler = type("Handler", (_Handler,), {"backend": backend_port, "start": start})
        self._server = _Server((LOOPBACK, port), handler)
        # How often it looks whether to stop; http.server's half a second would delay every Ctrl-C.
        threading.Thread(target=self._server.serve_forever, args=(0.05,), daemon=True).start()

    def stop(self) -> None:
        """Stop listening."""
        self._server.shutdown()
        self._server.server_close()


class _Server(ThreadingHTTPServer):
    daemon_threads = True


class _Handler(BaseHTTPRequestHandler):
    backend: int
    start: str

    def do_GET(self) -> None:  # noqa: N802  (the base class's name)
        if self.path == "/":
            self.send_response(302)
            self.send_header("Location", self.start)
            self.send_header("Content-Length", "0")
            self.end_headers()
            return
        connection = http.client.HTTPConnection(LOOPBACK, self.backend, timeout=10)
        try:
            connection.request("GET", self.path)
            self._pass_on(connection.getresponse())
        except (BrokenPipeError, ConnectionResetError):
            self.close_connection = True  # the browser went away
        except (OSError, http.client.HTTPException):
            self.send_error(502, "Rerun's server does not answer; it is being restarted")
        finally:
            connection.close()

    do_HEAD = do_GET  # noqa: N815

    def _pass_on(self, response: http.client.HTTPResponse) -> None:
        headers = {name: response.getheader(name) for name in _PASSED_ON}
        first = b""
        if (headers["Content-Type"] or "").startswith("text/html"):
            # The policy does not keep a browser from connecting ahead to foreign hosts.
            first = _FOREIGN_LINK.sub(b"", response.read())
            headers["Content-Length"] = headers["rerun-final-length"] = str(len(first))
        self.send_response(response.status)
        for name, value in headers.items():
            if value is not None:
                self.send_header(name, value)
        self.send_header("Content-Security-Policy", POLICY)
        self.end_headers()
        if self.command != "HEAD":
            self.wfile.write(first)
            while chunk := response.read(_CHUNK):
                self.wfile.write(chunk)

    def log_message(self, *_: object) -> None:
        """Say nothing: requests for the page are of no interest."""
