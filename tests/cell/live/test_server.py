"""The live page's server: who is answered what, and nobody waits for anybody."""

from __future__ import annotations

import http.client
import re
import socket
import threading
from contextlib import ExitStack, closing

import pytest

from arm.io.storage import data_file
from arm.plan_file import Move
from cell.files.task import read_task
from cell.live import server as liveserver
from cell.live.server import MOST_CHANGES, MOST_CONNECTIONS, LiveServer
from cell.live.view import Live
from cell.preview.page import page, waiting_page
from driver.execution.control import Control
from pages.live import SOON_S, Reader, ask, line, new_plan, until
from wire.looks_at_motion import looks


def test_the_page_and_nothing_else(server: LiveServer) -> None:
    assert server.socket.getsockname()[0] == "127.0.0.1"
    answer = ask(server.server_port, "GET", "/")
    assert answer.status == 200
    assert answer.headers["Content-Type"] == "text/html; charset=utf-8"
    assert answer.headers["Cache-Control"] == "no-store"
    assert "frame-ancestors 'none'" in answer.headers["Content-Security-Policy"]
    assert answer.read().decode() == waiting_page()
    for path in (
        "/x",
        "/?q=1",
        "/state",
        "/state?after=",
        "/state?after=-1",
        "/state?after=1&x",
        "/../etc/passwd",
        "//x",
        "/index.html",
    ):
        assert ask(server.server_port, "GET", path).status == 404


@pytest.mark.parametrize("path", ["/", "/state?after=0"])
def test_only_get(server: LiveServer, path: str) -> None:
    for method in ("POST", "PUT", "DELETE", "HEAD", "OPTIONS", "PATCH", "TRACE", "STOP"):
        answer = ask(server.server_port, method, path)
        assert answer.status == 405, method
        assert answer.headers["Allow"] == "GET"


@pytest.mark.parametrize("path", ["/", "/state?after=0", "/x"])
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


def test_the_state_is_for_its_own_page(server: LiveServer) -> None:
    for site in ("cross-site", "same-site"):
        assert ask(server.server_port, "GET", "/state?after=0", Sec_Fetch_Site=site).status == 403
        assert (
            ask(server.server_port, "GET", "/", Sec_Fetch_Site=site).status == 200
        )  # a link that somebody follows
    answer = ask(server.server_port, "GET", "/state?after=0", Sec_Fetch_Site="same-origin")
    assert answer.status == 200
    assert answer.headers["Content-Type"] == "application/json"
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
    assert "fetch(" not in page(still)
    for text in (page({**still, "live": "mark"}), waiting_page()):
        found = re.search(policy, text)
        assert found is not None
        assert found[1] == alone[1] + "; connect-src 'self'"
        assert "fetch(" in text
        assert re.findall(r"https?://(?!www\.w3\.org)\S+", text.split("<!--", 1)[0]) == []


def test_who_comes_late_gets_the_present_and_then_what_is_new(server: LiveServer, preview_case) -> None:
    plan = preview_case.plan
    index, move = next((i, s) for i, s in enumerate(plan.steps) if isinstance(s, Move))
    samples = [progress for _, progress in looks(move)][:5]
    early = Reader(server.server_port)
    server.put(lambda state: state.begin(Control()))
    server.put(line("a line"))
    server.put(new_plan(plan))
    server.put(lambda state: state.enter(move))
    for progress in samples:
        server.put(lambda state, progress=progress: state.sample(progress))
    early.until(lambda _: len(early.samples) == len(samples))
    late = Reader(server.server_port)
    state = late.read()
    assert state["plan"]["mark"] == "run-plan"
    assert state["step"]["index"] == index
    assert state["state"] == "runs"
    assert late.lines == early.lines == ["a line"]
    assert late.samples == early.samples
    assert [s["counts"] for s in late.samples] == [list(s.position.counts) for s in samples]
    assert ask(server.server_port, "GET", "/").read() == b"<p>plan</p>"
    server.put(lambda state: state.sample(samples[0]))
    for reader in (late, early):
        reader.until(lambda _, reader=reader: len(reader.samples) == len(samples) + 1)
    assert late.samples == early.samples
    assert late.samples[-1]["counts"] == early.samples[0]["counts"]


def test_an_answer_waits_for_news(server: LiveServer, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(liveserver, "HOLD_S", 0.05)
    reader = Reader(server.server_port)
    first = reader.read()
    assert reader.read() == first, "without news, the same after a while"
    monkeypatch.setattr(liveserver, "HOLD_S", 2.0 * SOON_S)
    states: list[dict[str, object]] = []
    waiting = threading.Thread(target=lambda: states.append(reader.read()), daemon=True)
    waiting.start()
    until(lambda: server._changed._waiters)
    server.put(line("news"))
    waiting.join(SOON_S)
    assert [state["lines"] for state in states] == [["news"]]


@pytest.mark.slow
def test_the_end_is_shown_and_the_server_goes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(liveserver, "GOODBYE_S", 5.0)  # on a busy host
    server = LiveServer(0)
    server.start()
    ends: list[str] = []
    readers = [Reader(server.server_port) for _ in range(3)]
    server.put(line("a line"))
    for reader in readers:
        reader.until(lambda _, reader=reader: reader.lines == ["a line"])
    threads = [threading.Thread(target=lambda r=r: ends.append(r.end()), daemon=True) for r in readers]
    for thread in threads:
        thread.start()
    server.end("stopped: the reason")
    for thread in threads:
        thread.join(SOON_S)
    assert ends == ["stopped: the reason"] * 3
    with pytest.raises(OSError, match="refused"):
        socket.create_connection(("127.0.0.1", server.server_port), 1.0)


def test_nobody_is_waited_for_where_nobody_watches(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(liveserver, "GOODBYE_S", -1.0)  # no time to sleep
    server = LiveServer(0)
    server.start()
    server.end("done")


def test_who_reads_too_slowly_is_let_go(server: LiveServer, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(liveserver._Handler, "timeout", 0.2)
    finish = liveserver._Handler.finish
    ended: list[str] = []

    def finished(handler: liveserver._Handler) -> None:
        ended.append(handler.path)
        finish(handler)

    monkeypatch.setattr(liveserver._Handler, "finish", finished)
    for i in range(200):
        server.put(line(f"{i} " + "x" * 60_000))
    reader = Reader(server.server_port)
    reader.until(lambda _: len(reader.lines) == 200)
    ended.clear()
    with closing(socket.socket()) as slow:
        slow.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        slow.connect(("127.0.0.1", server.server_port))
        slow.sendall(f"GET /state?after=0 HTTP/1.1\r\nHost: localhost:{server.server_port}\r\n\r\n".encode())
        until(lambda: ended == ["/state?after=0"])
    server.put(line("and on"))
    reader.until(lambda _: reader.lines[-1] == "and on")


def test_who_drives_the_arm_never_waits(preview_case) -> None:
    """Nobody takes anything out of the inbox, as if the server hung."""
    server = LiveServer(0)
    live = Live(server)
    live.begins(read_task(data_file("scenes/task2.toml")), Control())
    move = next(preview_case.plan.moves)
    _, progress = next(looks(move))

    def drive() -> None:
        live.step(move)
        live.line("a line")
        for _ in range(3 * MOST_CHANGES):
            live.progress(progress)

    driving = threading.Thread(target=drive, daemon=True)
    driving.start()
    driving.join(SOON_S)
    assert not driving.is_alive()
    assert server._inbox.qsize() == MOST_CHANGES
    server.server_close()
