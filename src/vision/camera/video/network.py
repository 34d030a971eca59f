"""Why no stream comes from a URL, as far as a plain connection shows."""

from __future__ import annotations

import socket
from urllib.parse import urlsplit

PORTS = {"rtsp": 554, "rtsps": 322, "rtmp": 1935, "http": 80, "https": 443}
CONNECT_S = 2.0


def why_no_stream(url: str, waited_s: float, deadline_s: float) -> str:
    """Say what is wrong with a stream that could not be opened, and what helps; never print the URL itself.

    Args:
        url: of the stream.
        waited_s: what opening took, s.
        deadline_s: after which it was given up, s.
    """
    parts = urlsplit(url)
    port = parts.port or PORTS.get(parts.scheme)
    if waited_s >= 0.95 * deadline_s:
        return f"no frame came from there within {deadline_s:g} s; is the camera on, and are host and port right?"
    if port is None or not parts.hostname:
        return "no stream comes from there; check address and port"
    try:
        socket.create_connection((parts.hostname, port), CONNECT_S).close()
    except socket.gaierror as error:
        return f"host {parts.hostname!r} is unknown ({error.strerror}); check its name"
    except OSError as error:
        why = error.strerror or f"no answer within {CONNECT_S:g} s"
        return f"port {port} of {parts.hostname} cannot be reached ({why}); is the camera on, and is the port right?"
    return f"port {port} of {parts.hostname} answers, but gives no stream; check path, user name and password"
