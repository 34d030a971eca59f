"""The live view without a browser: who is answered what, what a page is told and when, and that nobody ever waits."""

from __future__ import annotations

import http.client
import json
import re
import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import typer

from arm.errors import ExecutionStopped, InputError
from arm.files import data_file
from arm.motion import CountPath, Segment
from arm.planfile import Move, Plan
from arm.unit import load_unit
from cell import liveserver
from cell.cli import main
from cell.console import Console
from cell.live import Live, live_view
from cell.liveserver import MOST_CLIENTS, MOST_CONNECTIONS, MOST_MESSAGES, MOST_WAITING, Client, LiveServer
from cell.livestate import MOST_SAMPLES, Begun, Ended, LiveState, NewPlan, Told
from cell.preview.executed import OnPath
from cell.preview.page import page, waiting_page
from cell.preview.timeline import timed_steps
from cell.taskfile import read_task
from driver.control import Control
from looks_at_motion import looks

UNIT = load_unit("crs93")
SOON_S = 60.0


def until(holds: Callable[[], bool]) -> None:
    over = time.monotonic() + SOON_S
    while not holds():
        assert time.monotonic() < over
        time.sleep(0.005)


def new_plan(plan: Plan, name: str = "plan", text: bytes | None = b"<p>plan</p>") -> NewPlan:
    return NewPlan(f"run-{name}", name, plan, UNIT, text)


def told_by(events: list[bytes]) -> list[tuple[str, dict]]:
    found = re.findall(r"event: (\w+)\ndata: (.*)\n\n", b"".join(events).decode())
    return [(name, json.loads(data)) for name, data in found]


@pytest.fixture
def server() -> Iterator[LiveServer]:
    made = LiveServer(0)
    made.start()
    yield made
    made.end("done")


OPENED = ExitStack()


@pytest.fixture(autouse=True)
def all_closed() -> Iterator[None]:
    """Connections end with their test: one that an error still holds is found later, and blamed on another test."""
    with OPENED:
        yield


def ask(port: int, method: str, path: str, **headers: str) -> http.client.HTTPResponse:
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=SOON_S)
    OPENED.callback(connection.close)
    connection.putrequest(method, path, skip_host=True)
    for name, value in {"Host": f"127.0.0.1:{port}", **headers}.items():
        connection.putheader(name.replace("_", "-"), value)
    connection.endheaders()
    answer = connection.getresponse()
    OPENED.callback(answer.close)
    return answer


class Reader:
    """A page's stream of events."""

    def __init__(self, port: int) -> None:
        self.answer = ask(port, "GET", "/events")
        assert self.answer.status == 200

    def event(self) -> tuple[str, dict] | None:
        """The next event, or None at the end."""
        name, over = "", time.monotonic() + SOON_S
        for raw in self.answer:
            assert time.monotonic() < over, "nothing is told"  # though the stream lives
            line = raw.decode().rstrip("\n")
            if line.startswith("event: "):
                name = line.removeprefix("event: ")
            if line.startswith("data: "):
                return name, json.loads(line.removeprefix("data: "))
        return None

    def until(self, name: str, **values: object) -> dict:
        while (got := self.event()) is not None:
            if got[0] == name and values.items() <= got[1].items():
                return got[1]
        raise AssertionError(f"the stream ended without {name} {values}")

    def rest(self) -> list[tuple[str, dict]]:
        return list(iter(self.event, None))

    def close(self) -> None:
        self.answer.close()


# -- who is answered what


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


# -- what the page may do


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


# -- what the page is told


def test_a_sample_is_on_the_plans_clock_where_the_arm_is(preview_case) -> None:
    """Over moves that are one motion, under an override, and whether the arm is on the path or beside it."""
    plan, state = preview_case.plan, LiveState()
    timed, expected, shown = timed_steps(plan), [], []
    state.take(new_plan(plan))
    motion = max(plan.motions, key=lambda m: len(m.moves))
    assert len(motion.moves) == 3
    for k, move in enumerate(motion.moves):
        index = motion.first + k
        assert told_by(state.take(move))[0] == (
            "step",
            {"index": index, "name": move.name, "t": round(timed[index].start_s, 6)},
        )
        for t, progress in looks(move, stretch=1.0 + 0.25 * k, off=3):
            ((name, sample),) = told_by(state.take(progress))
            assert name == "sample"
            assert sample["motion"] == motion.first
            assert sample["counts"] == list(progress.position.counts)
            assert sample["override"] == round(progress.override, 4)
            assert (sample["done"], sample["total"]) == (progress.done, progress.total)
            expected.append(timed[index].start_s + t)
            shown.append(sample["t"])
    assert np.all(np.diff(shown) >= 0.0)
    off = np.abs(np.subtract(shown, expected))
    assert np.median(off) < 0.01
    assert off.max() < 0.3  # where it begins and ends, three counts are a long time


def test_a_sample_is_never_laid_behind_the_one_before() -> None:
    """Out and back on the same way: where the arm is does not tell which."""
    there, back = (Segment(1000, ((way, 0, 0, 0, 0, 0),)) for way in (20_000, -20_000))
    path = CountPath((0,) * 6, (there, back))
    on_path, times = OnPath(path, UNIT), np.arange(0.0, 2.0, 0.1)
    shown = [on_path.place(UNIT.positions(path.at([t])[0]), None)[0] for t in times]
    assert shown == pytest.approx(times, abs=1e-3)


def test_a_step_of_no_plan_has_a_name_alone(preview_case) -> None:
    plan, state = preview_case.plan, LiveState()
    move = next(plan.moves)
    state.take(new_plan(plan))
    state.take(replace(move, name="back out"))
    ((_, sample),) = told_by(state.take(next(looks(move))[1]))
    assert (sample["motion"], sample["t"]) == (None, None)
    told = dict(told_by(state.snapshot()))
    assert told["step"] == {"index": None, "name": "back out", "t": None}


def test_pauses_and_the_end_are_told_once(preview_case) -> None:
    control, state = Control(), LiveState()
    state.take(Begun(control))
    assert told_by(state.take(new_plan(preview_case.plan)))[-1][0] == "plan"
    assert told_by(state.take(preview_case.plan.steps[0]))[-1] == ("state", {"state": "runs"})
    assert state.changes() == []
    control.paused = True
    assert told_by(state.changes()) == [("state", {"state": "pauses"})]
    control.standing = True
    assert told_by(state.take(Told("paused: the arm stands"))) == [
        ("told", {"lines": ["paused: the arm stands"]}),
        ("state", {"state": "stands"}),
    ]
    control.paused = control.standing = False
    assert told_by(state.changes()) == [("state", {"state": "runs"})]
    assert told_by(state.take(Ended("stopped: why"))) == [
        ("state", {"state": "ended", "text": "stopped: why"})
    ]
    assert told_by(state.snapshot())[-1] == ("state", {"state": "ended", "text": "stopped: why"})


def test_a_new_plan_begins_anew_and_memory_is_bounded(preview_case) -> None:
    plan, state = preview_case.plan, LiveState()
    move = next(plan.moves)
    _, progress = next(looks(move))
    state.take(new_plan(plan, "to-start", b"first"))
    state.take(move)
    for _ in range(MOST_SAMPLES + 5):
        state.take(progress)
    past = dict(told_by(state.snapshot()))["past"]
    assert len(past["samples"]) == MOST_SAMPLES
    assert len(b"".join(state.snapshot())) < 4e6
    state.take(new_plan(plan, "plan", b"second"))
    told = told_by(state.snapshot())
    assert state.page == b"second"
    assert [name for name, _ in told] == ["plan", "past", "state"]
    assert told[0][1] == {"mark": "run-plan", "name": "plan", "sha256": plan.sha256}
    assert told[1][1]["samples"] == []
    assert told[2][1] == {"state": "waits"}


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


# -- nobody waits for anybody


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


# -- the run


class Followed(Console):
    """A console that keeps what it says."""

    def __init__(self) -> None:
        super().__init__(as_json=True)
        self.said: list[str] = []

    def say(self, text: str = "") -> None:
        self.said.append(text)

    @property
    def port(self) -> int:
        return int(re.fullmatch(r"live view: http://127\.0\.0\.1:(\d+)/", self.said[0])[1])


def follow(console: Followed, run: Callable[[Live, Reader], None], readers: list[Reader]) -> None:
    """A run with a live view, and somebody who reads it from the beginning."""
    with live_view(console) as live:
        readers.append(Reader(console.port))
        live.begins(read_task(data_file("scenes/task2.toml")), Control())
        run(live, readers[0])


def test_a_run_is_told_from_its_first_line_to_its_end(preview_case) -> None:
    console, readers = Followed(), []

    def run(live: Live, reader: Reader) -> None:
        console.step("it begins")
        assert reader.until("told")["lines"][0].endswith(" s] it begins")
        live.plan(preview_case.plan, "plan")
        plan = reader.until("plan")
        assert plan["sha256"] == preview_case.plan.sha256
        text = ask(console.port, "GET", "/").read().decode()
        assert f'"live":"{plan["mark"]}"' in text
        assert '"code":null' in text  # nobody confirms with a page of what runs already
        assert len(text) < 1.5e6
        raise ExecutionStopped("the reason")

    with pytest.raises(ExecutionStopped):
        follow(console, run, readers)
    assert readers[0].rest()[-1] == ("state", {"state": "ended", "text": "stopped: the reason"})
    assert console.listener is None


def test_a_plan_that_cannot_be_shown_does_not_end_the_run(preview_case) -> None:
    readers: list[Reader] = []

    def run(live: Live, reader: Reader) -> None:
        live.plan(replace(preview_case.plan, unit="crs97"), "plan")
        assert "no live page of plan: unit = 'crs93'" in reader.until("told")["lines"][0]
        assert reader.until("plan")["mark"] is None

    follow(Followed(), run, readers)
    assert readers[0].rest()[-1] == ("state", {"state": "ended", "text": "done"})


@pytest.mark.parametrize(
    ("error", "text"),
    [(KeyboardInterrupt(), "interrupted"), (typer.Exit(4), "not done"), (InputError("x"), "wrong input: x")],
)
def test_how_it_ended_is_told(error: BaseException, text: str) -> None:
    readers: list[Reader] = []

    def run(live: Live, reader: Reader) -> None:
        raise error

    with pytest.raises(type(error)):
        follow(Followed(), run, readers)
    assert readers[0].rest()[-1] == ("state", {"state": "ended", "text": text})


def test_a_port_that_is_taken_is_refused_before_anything_is_opened(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    with closing(socket.socket()) as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        words = ["run", str(data_file("scenes/task2.toml")), "--live-port", str(port)]
        monkeypatch.setattr("sys.argv", ["a465", *words])
        with pytest.raises(SystemExit) as ended:
            main()
    assert ended.value.code == InputError.exit_code == 2
    told = capsys.readouterr()
    assert f"--live-port = {port}: cannot listen on 127.0.0.1:{port}: Address already in use" in told.err
    assert told.out == ""
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("port", [-1, 80, 1023, 65536])
def test_a_port_that_is_none_is_refused(port: int) -> None:
    words = f"--live-port = {port}: must be from 1024 to 65535"
    with pytest.raises(InputError, match=words), live_view(Followed(), port):
        pass
