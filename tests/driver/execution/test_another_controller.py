"""The example of another controller: the same execution on it, and what it does when all does not go well."""

from __future__ import annotations

import socket
import sys
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from arm.errors import ExecutionStopped, ImpossibleError, InputError, LinkLost
from arm.plan_file import Move, Step, read_plan, write_plan
from driver.execution.control import Control
from driver.execution.controller import Controller
from driver.execution.execute import execute
from driver.execution.progress import Progress
from driver.line.clock import Clock
from plan.api import Body, Box, Target, load_a465, plan_poses, rot_x, transform, urdf_limits

EXAMPLES = Path(__file__).resolve().parents[3] / "examples"
Q = np.radians([-60, -40, -80, 0, -60, 0])
SCALE = 5.0  # controller seconds per second
Rows = tuple[Any, list[Step]]


@pytest.fixture(scope="module")
def example() -> Iterator[Any]:
    sys.path.insert(0, str(EXAMPLES))
    yield import_module("rows_over_a_socket")
    sys.path.remove(str(EXAMPLES))


@pytest.fixture(scope="module")
def plan_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    robot = load_a465(tool_length=0.134112, jaw_opening=0.0)
    bodies = (Body("table", Box((1.2, 1.4, 0.04)), transform(t=(0.3, 0.0, -0.02)), "table"),)
    there = Target("there", transform(rot_x(np.pi), (0.40, -0.1, 0.1)), free="rz", approach=0.03)
    file = tmp_path_factory.mktemp("rows") / "plan.json"
    write_plan(file, plan_poses(robot, bodies, [there], Q, urdf_limits(robot, acceleration=4.0)).plan())
    return file


@pytest.fixture(scope="module")
def rows(example: Any, plan_file: Path) -> Rows:
    found: Rows = import_module("11_another_controller").certified_rows(plan_file)
    return found


@pytest.fixture
def server(example: Any) -> Iterator[Any]:
    server = example.RowsServer(Q.tolist(), Clock(SCALE))
    yield server
    server.close()


@pytest.fixture
def arm(example: Any, server: Any, rows: Rows) -> Iterator[Any]:
    with example.RowsController(server.address, rows[0], Clock(SCALE)) as arm:
        arm.identify()
        yield arm


def when(done: int, act: Callable[[], None]) -> Callable[[Progress], None]:
    """Does something once, when so many rows of the first move are done."""
    acts = [act]
    return lambda progress: acts.pop()() if acts and progress.done >= done else None


def test_it_has_every_member_that_execution_needs(arm: Any) -> None:
    assert [n for n in vars(Controller) if not n.startswith("_") and not hasattr(arm, n)] == []


def test_a_certified_plan_is_executed_and_the_arm_passes_the_rows_that_were_certified(
    arm: Any, server: Any, rows: Rows
) -> None:
    unit, steps = rows
    seen: list[tuple[float, tuple[int, ...]]] = []
    moves = [step for step in steps if isinstance(step, Move)]
    results = execute(arm, steps, None, lambda p: seen.append((p.position.time_ms / 1e3, p.position.counts)))
    assert [result.step for result in results] == steps
    assert arm.counts() == moves[-1].path.end
    assert "GO" in server.heard
    # the server has kept the last rows: these are the knots of what was certified, to the last bit
    knots = np.concatenate([move.path.knots()[k > 0 :] for k, move in enumerate(moves)])
    assert np.array_equal(server.rows[:, 1:], unit.positions(knots))
    assert len(seen) > 10
    assert len({counts for _, counts in seen}) > 10


def test_an_override_makes_the_same_rows_slower(arm: Any, server: Any, rows: Rows) -> None:
    first = next(step for step in rows[1] if isinstance(step, Move))
    execute(arm, [first], control=Control(override=0.5))
    assert np.array_equal(server.rows[:, 1:], rows[0].positions(first.path.knots()))
    assert server.rows[-1, 0] == pytest.approx(2.0 * first.path.duration_s, rel=1e-3)


@pytest.mark.parametrize("how", ["abort", "error"])
def test_whatever_ends_a_motion_it_is_stopped_at_once_where_it_is(
    arm: Any, server: Any, rows: Rows, how: str
) -> None:
    control = Control()
    at: list[float] = []

    def end() -> None:
        at.append(time.monotonic())
        if how == "error":
            raise ValueError("of the caller")
        threading.Timer(0.05, control.abort).start()

    with pytest.raises(ExecutionStopped if how == "abort" else ValueError) as stopped:
        execute(arm, rows[1], None, when(20, end), control=control)
    assert server.heard[server.heard.index("GO") + 1 :].count("STOP") == 1
    assert time.monotonic() - at[0] < 1.0
    first = next(step for step in rows[1] if isinstance(step, Move))
    here = arm.settled_counts()
    assert (
        min(np.abs(first.path.sample(0.002) - here).max(axis=1)) < 1000
    )  # on the path, 1 mrad: its speed times 2 ms
    assert here not in (first.path.start, first.path.end)
    if how == "abort":
        assert stopped.value.data["reason"] == "aborted"
        assert stopped.value.data["state"]["at_rest"] is True
        assert stopped.value.data["state"]["counts"] == list(here)


def test_a_server_that_dies_is_noticed_and_the_arm_is_not_said_to_stand(
    arm: Any, server: Any, rows: Rows
) -> None:
    def die() -> None:
        server.answer = lambda *_: (_ for _ in ()).throw(OSError())  # its side of the socket is closed

    began = time.monotonic()
    with pytest.raises(ExecutionStopped, match="THE ARM MAY STILL BE MOVING") as stopped:
        execute(arm, rows[1], None, when(20, die))
    assert stopped.value.data["reason"] == "link"
    assert stopped.value.data["state"]["at_rest"] is False
    assert stopped.value.data["steps_done"] == 0
    assert time.monotonic() - began < 10.0


def test_a_server_that_hangs_in_motion_is_noticed_in_time(
    example: Any, arm: Any, server: Any, rows: Rows, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("driver.line.clock.LEAST_WALL_S", 0.5)
    free, asleep = threading.Event(), list[float]()

    def hang() -> None:
        answer = server.answer
        asleep.append(time.monotonic())
        server.answer = lambda *words: free.wait(20.0) and answer(*words)

    with pytest.raises(ExecutionStopped, match="no answer to AT within 2 s") as stopped:
        execute(arm, rows[1], None, when(20, hang))
    free.set()
    assert time.monotonic() - asleep[0] < 3.0  # ANSWER_S for the question and for STOP
    assert stopped.value.data["reason"] == "silent"
    assert stopped.value.data["state"]["at_rest"] is False


def test_a_server_that_takes_no_bytes_is_noticed_in_time(
    example: Any, rows: Rows, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(example, "ANSWER_S", 0.3)
    listening = socket.create_server(("127.0.0.1", 0))
    with example.RowsController(listening.getsockname(), rows[0], Clock(SCALE)) as arm:
        client, _ = listening.accept()
        client.sendall(b"1 rows 1\n")
        arm.identify()
        began = time.monotonic()
        with pytest.raises(LinkLost):
            arm._ask("ROWS " + 30_000_000 * "0")
        assert time.monotonic() - began < 2.0
        client.close()
    listening.close()


def test_a_lost_client_stops_the_arm(example: Any, arm: Any, server: Any, rows: Rows) -> None:
    with pytest.raises(ExecutionStopped):
        execute(arm, rows[1], None, when(20, arm.close))
    deadline = time.monotonic() + 5.0
    while len(server.rows) > 1 and time.monotonic() < deadline:
        time.sleep(0.01)
    assert len(server.rows) == 1  # it holds where it is
    with example.RowsController(server.address, rows[0], Clock(SCALE)) as again:
        again.identify()
        with pytest.raises(ImpossibleError, match="not at the start"):
            execute(again, rows[1])


def test_a_fault_in_motion_ends_it(arm: Any, server: Any, rows: Rows) -> None:
    with pytest.raises(ExecutionStopped, match="the unit reports a fault") as stopped:
        execute(arm, rows[1], None, when(20, lambda: setattr(server, "fault", True)))
    assert stopped.value.data["reason"] == "fault"
    assert "STOP" in server.heard[server.heard.index("GO") :]


def test_an_arm_that_leaves_its_rows_is_stopped(arm: Any, server: Any, rows: Rows) -> None:
    def push() -> None:
        server.rows = server.rows + np.array([0.0, 0.0, 0.01, 0.0, 0.0, 0.0, 0.0])

    with pytest.raises(ExecutionStopped, match="off its path") as stopped:
        execute(arm, rows[1], None, when(20, push))
    assert stopped.value.data["reason"] == "following"


def test_rows_that_arrive_damaged_do_not_begin(arm: Any, server: Any, rows: Rows) -> None:
    answer = server.answer

    def damaged(name: str, text: str = "") -> str:
        found: str = answer(name, text.replace("5", "6", 1) if name == "ROWS" else text)
        return found

    server.answer = damaged
    with pytest.raises(ExecutionStopped, match=r"GO .*refused by the unit"):
        execute(arm, rows[1])
    assert np.array_equal(server.rows, [[0.0, *Q]])


def test_what_is_not_certified_as_rows_is_not_sent(
    arm: Any, server: Any, rows: Rows, plan_file: Path
) -> None:
    with pytest.raises(ImpossibleError, match="certify rows"):
        execute(arm, read_plan(plan_file).steps)  # its cubics
    assert "ROWS" not in server.heard


def test_a_plan_that_states_more_clearance_than_it_has_is_refused(
    example: Any, plan_file: Path, tmp_path: Path
) -> None:
    plan = read_plan(plan_file)
    steps = tuple(
        replace(s, clearance=s.clearance + 0.02, clearances=tuple(c + 0.02 for c in s.clearances))
        if isinstance(s, Move)
        else s
        for s in plan.steps
    )
    write_plan(tmp_path / "wrong.json", replace(plan, steps=steps))
    with pytest.raises(ImpossibleError, match="the plan states"):
        import_module("11_another_controller").certified_rows(tmp_path / "wrong.json")


@pytest.mark.parametrize("says", [None, "hello\n", "1 ROWS 2\n"])
def test_a_server_that_does_not_identify_itself_gets_no_other_word(
    example: Any, rows: Rows, says: str | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("driver.line.clock.LEAST_WALL_S", 0.2)
    heard = bytearray()

    def serve() -> None:
        client, _ = listening.accept()
        with client:
            if says is not None:
                client.sendall(says.encode())
            while received := client.recv(100):
                heard.extend(received)

    listening = socket.create_server(("127.0.0.1", 0))
    thread = threading.Thread(target=serve, daemon=True)
    thread.start()
    began = time.monotonic()
    with example.RowsController(listening.getsockname(), rows[0], Clock(SCALE)) as arm:
        with pytest.raises(InputError, match="the other side"):
            arm.identify()
        with pytest.raises(InputError, match="not identified"):
            execute(arm, rows[1])
        state = arm.stop()
    assert time.monotonic() - began < 3.0
    assert state.at_rest is False
    thread.join(5.0)
    listening.close()
    assert bytes(heard) == b"1 WHO\n"
