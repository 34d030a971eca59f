"""The live page's server: who is answered what, and nobody waits for anybody."""

from __future__ import annotations

import http.client
import re
import socket
import threading
import time
from contextlib import ExitStack, closing

import pytest

from arm.io.storage import data_file
from arm.plan_file import Move
from cell.files.task import read_task
from cell.live import server as liveserver
from cell.live.server import MOST_CLIENTS, MOST_CONNECTIONS, MOST_MESSAGES, MOST_WAITING, Client, LiveServer
from cell.live.state import Begun, Told
from cell.live.view import Live
from cell.preview.page import page, waiting_page
from driver.execution.control import Control
from pages.live import OPENED, SOON_S, Reader, ask, new_plan, until
from wire.looks_at_motion import looks


def test_the_page_and_nothing_else(server: LiveServer) -> None:
    assert server.socket.getsockname()[0] == "127.0.0.1"
    answer = ask(server.server_port, "GET", "/")
    assert answer.status == 200
    assert answer.headers["Content-Type"] == "text/html; charset=utf-8"
    assert answer.headers["Cache-Control"] == "no-store"
    assert "frame-ancestors 'none'" in answer.headers["Content-Security-Policy"]
    assert answer.read().decode() == waiting_page()
    for path in ("/x", "/?q=1", "/events/", "/../etc/passwd", "//x", "/index.html"):
        assert ask(server.server_port, "GET", path).status == 404


@pytest.mark.parametrize("path", ["/", "/events"])
def test_only_get(server: LiveServer, path: str) -> None:
    for method in ("POST", "PUT", "DELETE", "HEAD", "OPTIONS", "PATCH", "TRACE", "STOP"):
        answer = ask(server.server_port, method, path)
        assert answer.status == 405, method
        assert answer.headers["Allow"] == "GET"


@pytest.mark.parametrize("path", ["/", "/events", "/x"])
def test_only_under_its_own_name(server: LiveServer, path: str) -> None:
    port = server.server_port
    for host in (
        "evil.example",
        f"evil.example:{port}",
        "127.0.0.1",
        f"127.0.0.1:{port + 1}",
        f"127.0.0.1.:{port}",
        "",
    ):
        assert ask(server.server_port, "GET", path, Host=host).status == 403, host
    with closing(socket.create_connection(("127.0.0.1", port), SOON_S)) as raw:
        raw.sendall(f"GET {path} HTTP/1.1\r\nHost: localhost:{port}\r\nHost: evil.example\r\n\r\n".encode())
        assert b" 403 " in raw.makefile("rb").readline()
    with closing(socket.create_connection(("127.0.0.1", port), SOON_S)) as raw:
        raw.sendall(f"GET {path} HTTP/1.0\r\n\r\n".encode())
        assert b" 403 " in raw.makefile("rb").readline()
    assert ask(server.server_port, "GET", "/", Host=f"localhost:{port}").status == 200


def test_events_are_for_its_own_page(server: LiveServer) -> None:
    for site in ("cross-site", "same-site"):
        assert ask(server.server_port, "GET", "/events", Sec_Fetch_Site=site).status == 403
        assert (
            ask(server.server_port, "GET", "/", Sec_Fetch_Site=site).status == 200
        )  # a link that somebody follows
    answer = ask(server.server_port, "GET", "/events", Sec_Fetch_Site="same-origin")
    assert answer.status == 200
    assert answer.headers["Content-Type"] == "text/event-stream"
    assert "Access-Control-Allow-Origin" not in answer.headers


def test_nonsense_and_silence_do_no_harm(server: LiveServer, monkeypatch: pytest.MonkeyPatch, capfd) -> None:
    monkeypatch.setattr(liveserver._Handler, "timeout", 0.2)
    for text in (b"\x00\xff\r\n\r\n", b"GET\r\n\r\n", b"GET / HTTP/9.9\r\n\r\n", b"A" * 70_000 + b"\r\n\r\n"):
        with closing(socket.create_connection(("127.0.0.1", server.server_port), SOON_S)) as raw:
            raw.sendall(text)
    with closing(socket.create_connection(("127.0.0.1", server.server_port), SOON_S)) as raw:
        raw.sendall(b"GET / HT")
        assert raw.recv(10) == b""  # it was let go
    assert ask(server.server_port, "GET", "/").status == 200
    assert capfd.readouterr() == ("", "")


def test_no_more_connections_than_it_may_have(server: LiveServer) -> None:
    with ExitStack() as stack:
        idle = [
            stack.enter_context(closing(socket.create_connection(("127.0.0.1", server.server_port), SOON_S)))
            for _ in range(MOST_CONNECTIONS + 1)
        ]
        assert idle[-1].recv(1) == b""
        idle[0].sendall(f"GET / HTTP/1.0\r\nHost: localhost:{server.server_port}\r\n\r\n".encode())
        assert b" 200 " in idle[0].makefile("rb").readline()
    until(lambda: _answers(server))


def _answers(server: LiveServer) -> bool:
    try:
        return ask(server.server_port, "GET", "/").status == 200
    except (http.client.HTTPException, OSError):
        return False


def test_a_live_page_may_ask_its_own_server_alone(preview_case) -> None:
    policy = r'http-equiv="Content-Security-Policy"\s+content="([^"]*)"'
    still = {"task": {}}
    alone = re.search(policy, page(still))
    assert alone is not None
    assert "connect-src" not in alone[1]
    assert "EventSource" not in page(still)
    for text in (page({**still, "live": "mark"}), waiting_page()):
        found = re.search(policy, text)
        assert found is not None
        assert found[1] == alone[1] + "; connect-src 'self'"
        assert "EventSource" in text
        assert re.findall(r"https?://(?!www\.w3\.org)\S+", text.split("<!--", 1)[0]) == []


def test_who_comes_late_is_told_the_present_first(server: LiveServer, preview_case) -> None:
    plan = preview_case.plan
    index, move = next((i, s) for i, s in enumerate(plan.steps) if isinstance(s, Move))
    samples = [progress for _, progress in looks(move)][:5]
    early = Reader(server.server_port)
    for message in (Begun(Control()), Told("a line"), new_plan(plan), move, *samples):
        server.hub.put(message)
    early.until("sample", counts=list(samples[-1].position.counts))
    late = Reader(server.server_port)
    told = [late.event() for _ in range(4)]
    assert [name for name, _ in told] == ["plan", "past", "step", "state"]
    assert told[0][1]["mark"] == "run-plan"
    assert told[1][1]["lines"] == ["a line"]
    assert [s["counts"] for s in told[1][1]["samples"]] == [list(s.position.counts) for s in samples]
    assert told[2][1]["index"] == index
    assert told[3][1] == {"state": "runs"}
    assert ask(server.server_port, "GET", "/").read() == b"<p>plan</p>"
    server.hub.put(samples[0])
    assert late.event() == ("sample", early.until("sample"))


def test_the_end_is_told_and_the_server_goes(preview_case, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(liveserver, "GOODBYE_S", 120.0)
    server = LiveServer(0)
    server.start()
    readers = [Reader(server.server_port) for _ in range(3)]
    server.hub.put(Told("a line"))
    for reader in readers:
        reader.until("told")
    began = time.monotonic()
    server.end("stopped: the reason")
    assert time.monotonic() - began < 60.0  # as soon as they have been told, whatever it would wait for them
    for reader in readers:
        assert reader.rest()[-1] == ("state", {"state": "ended", "text": "stopped: the reason"})
    with pytest.raises(OSError, match="refused"):
        socket.create_connection(("127.0.0.1", server.server_port), 1.0)


def test_eight_pages_and_no_more(server: LiveServer) -> None:
    readers = [Reader(server.server_port) for _ in range(MOST_CLIENTS)]
    assert ask(server.server_port, "GET", "/events").status == 503
    assert ask(server.server_port, "GET", "/").status == 200
    readers[0].close()
    server.hub.put(Told("whoever went is noticed when he is written to"))

    def seat_is_free() -> bool:
        answer = ask(server.server_port, "GET", "/events")
        answer.close()
        return answer.status == 200

    until(seat_is_free)


def test_who_reads_too_slowly_is_let_go(server: LiveServer, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(liveserver._Handler, "timeout", 0.2)
    slow = OPENED.enter_context(closing(socket.socket()))
    slow.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    slow.connect(("127.0.0.1", server.server_port))
    slow.sendall(f"GET /events HTTP/1.1\r\nHost: localhost:{server.server_port}\r\n\r\n".encode())
    until(lambda: len(server.hub.clients) == 1)
    stuck = server.hub.clients[0]
    reader = Reader(server.server_port)
    until(lambda: len(server.hub.clients) == 2)
    for i in range(2 * MOST_WAITING):
        server.hub.put(Told(f"{i} " + "x" * 2000))
        if i % 100 == 99:  # who reads is not behind by more than a hundred
            assert reader.until("told", lines=[f"{i} " + "x" * 2000])
    until(stuck.left.is_set)
    assert stuck not in server.hub.clients
    server.hub.put(Told("and on"))
    assert reader.until("told", lines=["and on"])


def test_a_client_that_is_full_gets_what_waits_and_no_more() -> None:
    client = Client()
    for i in range(MOST_WAITING + 3):
        client.offer([b"%d," % i])
    assert client.dropped
    assert client.take() == b"".join(b"%d," % i for i in range(MOST_WAITING))
    client.offer([b"late"])
    assert client.take() == b""


def test_who_drives_the_arm_never_waits(preview_case) -> None:
    """Nobody takes anything out of the inbox, as if the server hung."""
    server = LiveServer(0)
    live = Live(server.hub)
    live.begins(read_task(data_file("scenes/task2.toml")), Control())
    move = next(preview_case.plan.moves)
    _, progress = next(looks(move))

    def drive() -> None:
        live.step(move)
        live.told("a line")
        for _ in range(3 * MOST_MESSAGES):
            live.progress(progress)

    driving = threading.Thread(target=drive, daemon=True)
    driving.start()
    driving.join(SOON_S)
    assert not driving.is_alive()
    assert server.hub._inbox.qsize() == MOST_MESSAGES
    server.server_close()
