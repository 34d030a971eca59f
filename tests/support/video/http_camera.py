"""A camera that sends motion JPEG over HTTP on this machine."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

from video.timed_frames import TimedCamera


@contextmanager
def http_camera(camera: TimedCamera) -> Iterator[str]:
    """Serve a camera; yield the selector of its stream. Other paths than /live are not found, /silent never answers."""

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            if self.path == "/silent":
                camera.closing.wait(30.0)
                return
            if self.path != "/live":
                self.send_error(404)
                return
            self.send_response(200)
            self.send_header("Content-Type", "multipart/x-mixed-replace; boundary=frame")
            self.end_headers()
            try:
                for _, data in camera.jpegs():
                    head = f"--frame\r\nContent-Type: image/jpeg\r\nContent-Length: {len(data)}\r\n\r\n"
                    self.wfile.write(head.encode() + data + b"\r\n")
            except OSError:  # the reader has left
                pass

        def log_message(self, format: str, *args: object) -> None:
            pass

    server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    server.daemon_threads = True
    thread = threading.Thread(target=server.serve_forever, args=(0.01,), daemon=True)
    thread.start()
    try:
        yield f"video:http://127.0.0.1:{server.server_address[1]}/live"
    finally:
        camera.closing.set()
        server.shutdown()
        server.server_close()
        thread.join(5.0)
