"""A read-only server on the loopback that shows a run: one page, and the run's state as JSON, which the page polls.

The thread that drives the arm only puts changes into a queue, which never blocks it. The server's thread empties the
queue several times a second and keeps the state; a thread per request answers. A request for the state waits until the
state changes (long polling). So the page is up to date even in the background, where browsers slow its timers down.
"""

from __future__ import annotations

import json
import math
import queue
import re
import socketserver
import sys
import threading
import time
from collections.abc import Callable
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

from arm.errors import InputError
from cell.live.state import LiveState
from cell.preview.page import waiting_page

HOST = "127.0.0.1"
MOST_CONNECTIONS = 32
MOST_CHANGES = 20_000  # in the queue; further ones are dropped
PATIENCE_S = 5.0  # timeout of a client that neither sends nor reads
TICK_S = 0.1  # period in which changes become visible
HOLD_S = 1.0  # longest wait of an answer for a change
GOODBYE_S = 0.5  # in which open pages can ask for the end of the run
HEADERS = {
    "Cache-Control": "no-store",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Content-Security-Policy": "frame-ancestors 'none'",
    "Connection": "close",
}
_STATE = re.compile(r"/state\?after=(\d{1,15})", re.ASCII)


class LiveServer(ThreadingHTTPServer):
    """The server of one run.

    Args:
        port: port to listen on; 0: any free port.

    Raises:
        InputError: it cannot listen there.
    """

    daemon_threads = True
    request_queue_size = 2 * MOST_CONNECTIONS  # with a short queue, further connections wait for seconds

    def __init__(self, port: int) -> None:
        self._inbox: queue.SimpleQueue[Callable[[LiveState], None]] = queue.SimpleQueue()
        self._state, self._changed = LiveState(), threading.Condition()  # its lock guards the state
        self._waiting_page = waiting_page().encode()
        self._asked_s = -math.inf  # monotonic time when a page last asked for the state
        self._connections = threading.BoundedSemaphore(MOST_CONNECTIONS)
        try:
            super().__init__((HOST, port), _Handler)
        except OSError as error:
            raise InputError(
                f"--live-port = {port}: cannot listen on {HOST}:{port}: {error.strerror}; "
                "omit it to use any free port",
                port=port,
            ) from error
        self._serving = threading.Thread(
            target=self.serve_forever, args=(TICK_S,), name="live server", daemon=True
        )

    def server_bind(self) -> None:
        """Bind without the look-up of the host name that the base class does."""
        socketserver.TCPServer.server_bind(self)
        self.server_name, self.server_port = HOST, self.server_address[1]

    @property
    def url(self) -> str:
        """URL of the page."""
        return f"http://{HOST}:{self.server_port}/"

    @property
    def hosts(self) -> tuple[str, str]:
        """Allowed Host headers; any other may come from a foreign page (DNS rebinding)."""
        return f"{HOST}:{self.server_port}", f"localhost:{self.server_port}"

    def start(self) -> None:
        """Start the thread that serves."""
        self._serving.start()

    def put(self, change: Callable[[LiveState], None]) -> None:
        """Queue a change of the state without waiting. Any thread may call this."""
        if self._inbox.qsize() < MOST_CHANGES:
            self._inbox.put(change)

    def service_actions(self) -> None:
        """Apply the queued changes. `serve_forever` calls this after each request and every TICK_S."""
        with self._changed:
            while not self._inbox.empty():
                self._inbox.get()(self._state)
            self._state.refresh()
            self._changed.notify_all()

    def page(self) -> bytes:
        """Return the page of the plan being executed, or the waiting page before the first."""
        with self._changed:
            return self._state.page or self._waiting_page

    def state(self, after: int) -> bytes:
        """Return the state as JSON when it is later than a version, or after HOLD_S."""
        self._asked_s = time.monotonic()
        with self._changed:
            self._changed.wait_for(lambda: self._state.version > after, HOLD_S)
            state = self._state.since(after)
        return json.dumps(state, separators=(",", ":"), allow_nan=False).encode()

    def end(self, text: str) -> None:
        """Show the end of the run to the pages that are open, and close."""
        self.put(lambda state: state.end(text))
        if time.monotonic() - self._asked_s < 2.0 * HOLD_S:
            time.sleep(GOODBYE_S)
        self.shutdown()
        self.server_close()

    def process_request(self, request: Any, client_address: Any) -> None:
        """Serve a connection in its own thread; refuse it beyond MOST_CONNECTIONS."""
        if self._connections.acquire(blocking=False):
            super().process_request(request, client_address)
        else:
            self.shutdown_request(request)

    def process_request_thread(self, request: Any, client_address: Any) -> None:
        """Serve one connection to its end."""
        try:
            super().process_request_thread(request, client_address)
        finally:
            self._connections.release()

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Ignore a client that left or was too slow."""
        if not isinstance(sys.exc_info()[1], OSError):
            super().handle_error(request, client_address)


class _Handler(BaseHTTPRequestHandler):
    """Answer one request: a GET of the page or of the state."""

    server: LiveServer
    timeout = PATIENCE_S

    def parse_request(self) -> bool:
        """Refuse requests for another host, and any method but GET."""
        if not super().parse_request():
            return False
        names = self.headers.get_all("Host", [])
        if len(names) != 1 or names[0] not in self.server.hosts:
            return self._refuse(HTTPStatus.FORBIDDEN, f"this is {self.server.url}")
        if self.command != "GET":
            return self._refuse(HTTPStatus.METHOD_NOT_ALLOWED, "only GET: this view changes nothing")
        return True

    def do_GET(self) -> None:
        """Send the page, the state, or a refusal."""
        if self.path == "/":
            self._send(HTTPStatus.OK, "text/html; charset=utf-8", self.server.page())
        elif (asked := _STATE.fullmatch(self.path)) is None:
            self._refuse(HTTPStatus.NOT_FOUND, "must be / or /state?after=VERSION")
        # Browsers state the origin of a request. A page of another origin must not occupy connections.
        elif self.headers.get("Sec-Fetch-Site", "same-origin") not in ("same-origin", "none"):
            self._refuse(HTTPStatus.FORBIDDEN, "only the page of this server may read the state")
        else:
            self._send(HTTPStatus.OK, "application/json", self.server.state(int(asked[1])))

    def _refuse(self, status: HTTPStatus, text: str) -> bool:
        self._send(status, "text/plain; charset=utf-8", f"{status.value} {status.phrase}: {text}\n".encode())
        return False

    def _send(self, status: HTTPStatus, kind: str, body: bytes) -> None:
        self.send_response(status)
        for name, value in {**HEADERS, "Content-Type": kind, "Content-Length": str(len(body))}.items():
            self.send_header(name, value)
        if status == HTTPStatus.METHOD_NOT_ALLOWED:
            self.send_header("Allow", "GET")
        self.end_headers()
        self.wfile.write(body)

    def version_string(self) -> str:
        """Value of the Server header."""
        return "a465"

    def log_message(self, format: str, *args: Any) -> None:
        """Do not log requests: the terminal is for the run."""
