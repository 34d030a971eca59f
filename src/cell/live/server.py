"""A read-only server on the loopback that shows a run: one page, one stream of events.

The thread that drives the arm only puts messages into an inbox, which never blocks it. One thread takes them out, keeps
the state and queues events for each client; a thread per client writes them. A client that reads too slowly is
disconnected, and its page reconnects.
"""

from __future__ import annotations

import queue
import socket
import socketserver
import sys
import threading
import time
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

from arm.errors import InputError
from cell.live.state import Ended, LiveState, Message
from cell.preview.page import waiting_page

HOST = "127.0.0.1"
MOST_CLIENTS = 8  # event streams at a time
MOST_CONNECTIONS = 32
MOST_WAITING = 512  # queued events of a client
MOST_MESSAGES = 20_000  # messages in the inbox; more are dropped
PATIENCE_S = 5.0  # timeout of a client that neither sends nor reads
BEAT_S = 1.0  # heartbeat of an idle stream
BUFFER = 1 << 16  # bytes: the system's send buffer for a client
GOODBYE_S = 1.0  # time to send the end of the run to the clients
HEADERS = {
    "Cache-Control": "no-store",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Content-Security-Policy": "frame-ancestors 'none'",
}


class Client:
    """One reader of events.

    Attributes:
        dropped: it was too slow, or the run has ended: queued events are still written, no more are queued.
        left: its connection is closed.
    """

    def __init__(self) -> None:
        self.dropped = False
        self.left = threading.Event()
        self._waiting: queue.Queue[bytes] = queue.Queue(MOST_WAITING)

    def offer(self, events: list[bytes]) -> None:
        """Queue events to write. If the queue is full, the client is dropped."""
        try:
            if events and not self.dropped:
                self._waiting.put_nowait(b"".join(events))
        except queue.Full:
            self.dropped = True

    def take(self) -> bytes:
        """Return everything to write now, or a heartbeat; empty at the end."""
        try:
            found = [self._waiting.get(timeout=BEAT_S / 10 if self.dropped else BEAT_S)]
        except queue.Empty:
            return b"" if self.dropped else b":\n\n"
        while not self._waiting.empty():
            found.append(self._waiting.get_nowait())
        return b"".join(found)


class Hub(threading.Thread):
    """Keeps the state and sends events to the clients.

    Attributes:
        page: the page served now.
    """

    def __init__(self) -> None:
        super().__init__(name="live view", daemon=True)
        self._waiting_page = self.page = waiting_page().encode()
        self.clients: list[Client] = []
        self._inbox: queue.SimpleQueue[Message | Client] = queue.SimpleQueue()
        self._state = LiveState()

    def put(self, message: Message | Client) -> None:
        """Queue a message, or a new client. Returns at once; may be called from any thread."""
        if self._inbox.qsize() < MOST_MESSAGES:
            self._inbox.put(message)

    def run(self) -> None:
        """Process messages until the run has ended."""
        message: Message | Client | None = None
        while not isinstance(message, Ended):
            try:
                message = self._inbox.get(timeout=BEAT_S / 5)
            except queue.Empty:
                self._tell(self._state.changes())
                continue
            if isinstance(message, Client):
                message.offer(self._state.snapshot())
                self.clients.append(message)
            else:
                self._tell(self._state.take(message))
        for client in self.clients:
            client.dropped = True

    def _tell(self, events: list[bytes]) -> None:
        self.page = self._state.page or self._waiting_page
        for client in self.clients:
            client.offer(events)
        self.clients = [client for client in self.clients if not client.dropped]


class LiveServer(ThreadingHTTPServer):
    """The server of one run.

    Args:
        port: to listen on; 0: any free port.

    Raises:
        InputError: it cannot listen there.
    """

    daemon_threads = True
    request_queue_size = 2 * MOST_CONNECTIONS  # with a short queue, further connections wait for seconds

    def __init__(self, port: int) -> None:
        self.hub = Hub()
        self.seats = threading.BoundedSemaphore(MOST_CLIENTS)
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
            target=self.serve_forever, args=(0.1,), name="live server", daemon=True
        )

    def server_bind(self) -> None:
        """Bind without the base class's look-up of the host name."""
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
        """Start the threads that serve."""
        self.hub.start()
        self._serving.start()

    def end(self, text: str) -> None:
        """Send the end of the run to the clients, wait at most GOODBYE_S, and close."""
        self.hub.put(Ended(text))
        over = time.monotonic() + GOODBYE_S
        self.hub.join(GOODBYE_S)
        for client in self.hub.clients:
            client.left.wait(max(over - time.monotonic(), 0.0))
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
    """Answers one request: only GET of the page or of the events."""

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
        """Send the page, the events, or a refusal."""
        match self.path:
            case "/":
                page = self.server.hub.page
                self._begin(HTTPStatus.OK, "text/html; charset=utf-8", len(page))
                self.wfile.write(page)
            case "/events":
                self._events()
            case _:
                self._refuse(HTTPStatus.NOT_FOUND, "must be / or /events")

    def _events(self) -> None:
        # a foreign page must not use up the event streams; browsers name the origin of a request
        if self.headers.get("Sec-Fetch-Site", "same-origin") not in ("same-origin", "none"):
            self._refuse(HTTPStatus.FORBIDDEN, "only the page of this server may read events")
            return
        seats = self.server.seats
        if not seats.acquire(blocking=False):
            self._refuse(HTTPStatus.SERVICE_UNAVAILABLE, f"at most {MOST_CLIENTS} pages can be open")
            return
        client = Client()
        try:
            self.connection.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, BUFFER)
            self.server.hub.put(client)  # before the response begins, so that the client misses no event
            self._begin(HTTPStatus.OK, "text/event-stream", None)
            while (text := client.take()) and (self.server.hub.is_alive() or client.dropped):
                self.wfile.write(text)
        finally:
            client.dropped = True
            client.left.set()
            seats.release()

    def _refuse(self, status: HTTPStatus, text: str) -> bool:
        body = f"{status.value} {status.phrase}: {text}\n".encode()
        self._begin(status, "text/plain; charset=utf-8", len(body))
        self.wfile.write(body)
        return False

    def _begin(self, status: HTTPStatus, kind: str, length: int | None) -> None:
        self.send_response(status)
        for name, value in {**HEADERS, "Content-Type": kind, "Connection": "close"}.items():
            self.send_header(name, value)
        if status == HTTPStatus.METHOD_NOT_ALLOWED:
            self.send_header("Allow", "GET")
        if length is not None:
            self.send_header("Content-Length", str(length))
        self.end_headers()

    def version_string(self) -> str:
        """Value of the Server header."""
        return "a465"

    def log_message(self, format: str, *args: Any) -> None:
        """Do not log requests: the terminal is for the run."""
