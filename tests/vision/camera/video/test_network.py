"""A stream that cannot be opened is explained as far as a plain connection tells, and its login is not repeated."""

from __future__ import annotations

import socket

import pytest

from vision.camera.video.network import why_no_stream


def test_what_a_connection_tells(monkeypatch: pytest.MonkeyPatch) -> None:
    faults: dict[str, Exception | None] = {
        "unknown": socket.gaierror(-2, "Name or service not known"),
        "closed": ConnectionRefusedError(111, "Connection refused"),
        "silent": TimeoutError("timed out"),
        "open": None,
    }
    ports: list[int] = []

    def connect(address: tuple[str, int], timeout: float) -> socket.socket:
        ports.append(address[1])
        if (fault := faults[address[0]]) is not None:
            raise fault
        return socket.socket()

    monkeypatch.setattr(socket, "create_connection", connect)
    told = {host: why_no_stream(f"rtsp://me:secret@{host}/1", 0.1, 10.0) for host in faults}
    assert told["unknown"] == "host 'unknown' is unknown (Name or service not known); check its name"
    assert told["closed"].startswith(
        "port 554 of closed cannot be reached (Connection refused); is the camera on"
    )
    assert "cannot be reached (no answer within 2 s)" in told["silent"]
    assert told["open"].startswith("port 554 of open answers, but gives no stream; check path, user name")
    why_no_stream("http://open:81/", 0.1, 10.0)
    assert ports == [554] * 4 + [81]


def test_what_is_known_without_a_connection(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(socket, "create_connection", lambda *_: pytest.fail("connects"))
    assert "no frame came from there within 10 s" in why_no_stream("rtsp://camera/1", 10.0, 10.0)
    assert why_no_stream("udp://@:1234", 0.1, 10.0) == "no stream comes from there; check address and port"
