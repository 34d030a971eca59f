"""Stopped anywhere, and gone on from there: one lasting cell, one session after the other on its controller."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from arm.board import plate_name
from arm.controller.segments import CountPath, Segment
from arm.errors import ExecutionStopped, ImpossibleError, InputError
from arm.io.storage import data_file
from arm.plan_file import Move, Plan, read_plan
from arm.se3 import frozen, inverse, transform
from cell.accuracy.plan_budgets import plan_budgets
from cell.commands.run import execute_plan, resume_plan
from cell.console import Console
from cell.cubes.recovery import Recovery
from cell.files.cube_widths import FILE, read_widths
from cell.files.task import read_task
from cell.scene.build import cube_name
from cell.scene.displaced import DisplacedCube
from cell.session.connection import WhichCell
from cell.task.planning import Rest, plan_rest
from cell.task.resume import (
    _back_out,
    _carried_near,
    _known,
    _on_table,
    _set_down,
    _station,
    _take_stock,
    _touched,
    carried_by,
    resume,
)
from plan.scene import scene_from_json
from tasks.true_look import true_look
from vision.observation import Observation
from vision.occupancy.classify import Occupancy
from vision.occupancy.seated import CubeWidth, Seating
from wire.lasting_cell import LastingCell

pytestmark = pytest.mark.xdist_group("resume")
NOMINAL = CubeWidth(0.040, 5e-5)


@pytest.fixture
def lasting(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[LastingCell]:
    found = LastingCell(tmp_path, monkeypatch, "task2")
    with found.emulator:
        yield found


@pytest.fixture
def clearing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[LastingCell]:
    found = LastingCell(tmp_path, monkeypatch, "task1")
    with found.emulator:
        yield found


@pytest.mark.slow
def test_stopped_again_and_again_the_task_is_finished(
    lasting: LastingCell, capsys: pytest.CaptureFixture[str]
) -> None:
    at, number = lasting, [0]

    def resume() -> dict[str, Any]:
        number[0] += 1
        return resume_plan(
            at.newest, at.file, Console(), WhichCell(at.url), at.folder / f"resumed-{number[0]}"
        )

    def first() -> dict[str, Any]:
        return execute_plan(at.plan, at.file, Console(), WhichCell(at.url), at.folder / "first")

    at.stopped(first, "close on it", 0.0)  # the fingers are beside the cube
    assert at.held() == []
    at.stopped(resume, "lift off", 0.4)  # half out of its hole
    assert len(at.held()) == 1
    at.stopped(resume, ": to 03-04", 0.4)  # set down, on its way across
    assert len(at.held()) == 1
    at.stopped(resume, "approach 03-04", 0.7)  # half in its new hole
    assert len(at.held()) == 1
    for folder in ("resumed-1", "resumed-2", "resumed-3"):  # measured once, handed on from stop to stop
        (width,) = read_widths(at.folder / folder, NOMINAL).values()
        assert width.value == pytest.approx(0.040, abs=4e-5)
        assert width.std < 0.7 * NOMINAL.std  # of small photographs
    assert not (at.folder / "first" / FILE).exists()  # no cube was in the jaws
    report = resume()
    said = capsys.readouterr().out
    assert said.count("it backs out along the jaws first") == 1
    assert said.count("is in the jaws; its target is 03-04/") == 3
    assert f"to go on: a465 execute {at.folder}/resumed-3/set-down.json" in said
    assert all(c["placed"] for c in report["cubes"])
    assert max(c["error_mm"] for c in report["cubes"]) <= 1.0
    target = at.simulated.world.boards[1]
    truly = [c.T_base_cube for c in at.simulated.cubes(at.emulator.counts())]
    near = [
        min(
            np.linalg.norm((inverse(target.T_base_board @ target.board.T_board_hole(hole)) @ T)[:2, 3])
            for hole in range(4)
        )
        for T in truly
    ]
    assert max(near) < 1e-9
    assert not [e for e in at.simulated.events if e.what in ("pushed", "fallen", "missed")]
    assert at.emulator.violations == ()
    assert all(
        m.certified
        for p in at.folder.glob("resumed-*/*.json")
        if p.name not in ("report.json", FILE)
        for m in read_plan(p).moves
    )


@pytest.mark.slow
def test_clearing_a_board_goes_on_with_the_cubes_that_stand_on_the_table(
    clearing: LastingCell, capsys: pytest.CaptureFixture[str]
) -> None:
    at = clearing

    def resume(name: str) -> dict[str, Any]:
        return resume_plan(at.newest, at.file, Console(), WhichCell(at.url), at.folder / name)

    def first() -> dict[str, Any]:
        return execute_plan(at.plan, at.file, Console(), WhichCell(at.url), at.folder / "first")

    at.stopped(first, "let go", 0.0)  # on the table, still in the jaws
    assert len(at.held()) == 1
    at.stopped(
        lambda: resume("second"), "lift off", 0.5
    )  # of the other cube; the first one stands on the table
    assert len(at.held()) == 1
    report = resume("third")
    assert capsys.readouterr().out.count("is in the jaws; its target is table/") == 2
    assert all(c["placed"] for c in report["cubes"])
    cubes = at.simulated.cubes(at.emulator.counts())
    assert [c.where.partition("/")[0] for c in cubes] == ["table", "table"]
    apart = np.linalg.norm(cubes[0].T_base_cube[:2, 3] - cubes[1].T_base_cube[:2, 3])
    assert apart >= 0.075 - 1e-3
    assert not [e for e in at.simulated.events if e.what in ("pushed", "fallen", "missed")]
    assert at.emulator.violations == ()


@pytest.mark.slow
@pytest.mark.parametrize(("state", "confirmed"), [("seated", True), ("unsure", False)])
def test_a_cube_of_before_the_stop_is_done_only_where_the_look_confirms_it(
    lasting: LastingCell,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    state: Any,
    confirmed: bool,
) -> None:
    """The rest is done all the same; the run ends as not confirmed."""
    at = lasting

    def first() -> dict[str, Any]:
        return execute_plan(at.plan, at.file, Console(), WhichCell(at.url), at.folder / "first")

    def rest() -> dict[str, Any]:
        return resume_plan(at.newest, at.file, Console(), WhichCell(at.url), at.folder / "second")

    second = read_plan(at.plan).task["cubes"][1]["from"]
    at.stopped(first, f"to {second}", 0.5)  # the first cube stands in its hole
    monkeypatch.setattr("cell.task.resume.seated", lambda *_: Seating(state, "a shadow is on it"))
    if confirmed:
        assert all(c["placed"] for c in rest()["cubes"])
        assert "1 of 2 cubes are where they should be" in capsys.readouterr().out
        return
    with pytest.raises(ExecutionStopped, match=r"1 of 2 cubes not confirmed: .*a shadow is on it") as ended:
        rest()
    assert [c["placed"] for c in ended.value.data["cubes"]] == [False, True]
    assert "0 of 2 cubes are where they should be" in capsys.readouterr().out


def test_a_unit_that_lost_its_positions_is_not_resumed(lasting: LastingCell) -> None:
    with pytest.raises(ImpossibleError, match="must be homed"):
        resume_plan(lasting.plan, lasting.file, Console(), WhichCell(lasting.url), lasting.folder / "run")
    moving = ("COORDMV", "COORDS", "HH", "GG:")
    assert not any(line.startswith(moving) for _, line in lasting.emulator.lines)


def test_which_cube_is_in_the_jaws_is_told_or_refused(lasting: LastingCell) -> None:
    task, plan = lasting.task, read_plan(lasting.plan)
    unit, transfers = task.cell.unit, plan.task["cubes"]
    states = {"01-02": ("cube", "empty", "cube", "empty"), "03-04": ("empty",) * 4}
    boards = _known(Observation(), task, plan).boards
    there = Observation(tuple(replace(b, occupancy=tuple(map(Occupancy, states[b.name]))) for b in boards))
    at_start = tuple(int(c) for c in unit.counts(task.cell.q_start))
    for looked in (there, Observation(), there.with_moves({t["cube"]: "nowhere/1" for t in transfers})):
        with pytest.raises(ImpossibleError, match=r"it cannot be identified.*take it out of"):
            carried_by(task, plan, at_start, looked)
    one = there.with_moves({transfers[1]["cube"]: "nowhere/1"})
    assert carried_by(task, plan, at_start, one)[0] == transfers[1]
    for index, transfer in enumerate(transfers):
        for move in (m for m in plan.moves if m.cube == index and m.held is not None):
            middle = tuple(int(c) for c in move.path.knots()[len(move.path.segments) // 2])
            assert carried_by(task, plan, middle, Observation())[0] == transfer


def test_what_the_jaws_hold_is_where_they_closed_on_it(lasting: LastingCell) -> None:
    task, plan = lasting.task, read_plan(lasting.plan)
    unit, robot = task.cell.unit, task.cell.robot()
    scene = scene_from_json(plan.scene, robot, task.cell.robot_holding())
    for index, transfer in enumerate(plan.task["cubes"]):
        lift = next(m for m in plan.moves if m.cube == index and m.held is not None)
        held = carried_by(task, plan, lift.path.end, Observation())[1]
        assert held.cube == transfer["cube"]
        at = robot.T_base_tool(unit.positions(lift.path.start)) @ held.T_tool_cube
        assert at == pytest.approx(scene.cube(held.cube).T_base_body, abs=1e-9)


@pytest.mark.few(1)
@pytest.mark.parametrize("following_deg", [0.0, 0.08])
def test_a_cube_in_the_jaws_is_set_down_only_if_it_enters_its_pocket(following_deg: float) -> None:
    """As certainly as from its hole, with the boards that are seen now; otherwise it stays in the jaws."""
    task = read_task(data_file("scenes/realistic/task2.toml"))
    task = replace(task, cell=replace(task.cell, following_error=np.radians(following_deg)))
    cell, seen = task.cell, true_look(task)
    plan = plan_rest(Rest(task, seen, cell.q_start, 0.5))
    assert plan is not None
    lift = next(m for m in plan.moves if m.held is not None and m.cube == 1)
    transfer, jaws = carried_by(task, plan, lift.path.end, seen)

    def keep(made: Plan, name: str) -> None:
        raise RuntimeError(name)  # what follows moves the arm

    q = cell.unit.positions(lift.path.end)
    run: Any = SimpleNamespace(
        task=task,
        q_now=lambda: q,
        speed=0.5,
        keep=keep,
        budgets={},
        recovery=Recovery(task, 0),
        rest=lambda look, q: Rest(task, look, q, 0.5),
    )
    if following_deg:
        with pytest.raises(ImpossibleError, match=f"{transfer['cube']} enters {transfer['to']} with"):
            _set_down(run, plan, (seen, seen), transfer, jaws, 0.3)
        assert run.budgets == {}
        return
    with pytest.raises(RuntimeError, match="set-down"):
        _set_down(run, plan, (seen, seen), transfer, jaws, 0.3)
    (budget,) = run.budgets.values()
    planned = plan_budgets(cell, seen, plan)[1]
    assert (budget.cube, budget.source, budget.target) == (planned.cube, planned.source, planned.target)
    assert budget.sideways == pytest.approx(planned.sideways, rel=0.3)  # at another grasp of the hole
    with pytest.raises(RuntimeError, match="set-down"):  # a board that the arm hides is not judged
        _set_down(run, plan, (seen, Observation()), transfer, jaws, 0.3)


def test_wherever_a_move_stops_however_fast_it_was_its_cube_is_known(lasting: LastingCell) -> None:
    """At the unit's full speed of an axis, and everywhere between the samples that it is looked for at."""
    task, plan = lasting.task, read_plan(lasting.plan)
    unit = task.cell.unit
    index, move = next((i, s) for i, s in enumerate(plan.steps) if isinstance(s, Move) and s.held is not None)
    speed = unit.limits().velocity * np.abs(unit.counts_per_rad)
    for joint in range(6):
        row = tuple(int(0.1 * speed[joint]) * (k == joint) for k in range(6))
        fast = CountPath(move.path.start, (Segment(100, (row, (0,) * 6, (0,) * 6)),) * 2)
        one = replace(plan, steps=(*plan.steps[:index], replace(move, path=fast)))
        for counts in np.rint(fast.sample(1e-3)).astype(int):
            found = _carried_near(task, one, unit.positions(counts))
            assert found == plan.task["cubes"][move.cube or 0]


def test_cubes_stand_on_the_table_only_where_the_task_has_places_there(
    lasting: LastingCell, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    plan = read_plan(lasting.plan)
    assert _on_table(lasting.task, plan) == {}
    (tmp_path / "one").mkdir()
    other = LastingCell(tmp_path / "one", monkeypatch, "task1")
    found = _on_table(other.task, read_plan(other.plan))
    assert set(found) == {cube_name(t["to"]) for t in read_plan(other.plan).task["cubes"]}


def test_before_anything_moves_on_the_registers_are_those_of_the_cell(lasting: LastingCell) -> None:
    """Not those that a run before it, or another client, has left."""
    done: list[Any] = []

    def looks() -> None:
        done.append("looks")
        raise ExecutionStopped("enough")

    mars = SimpleNamespace(
        initialise=lambda **how: done.append(how),
        set_registers=lambda *registers: done.append(registers),
        settled_counts=looks,
    )
    run: Any = SimpleNamespace(connection=SimpleNamespace(mars=mars), task=lasting.task)
    with pytest.raises(ExecutionStopped, match="enough"):
        resume(run, read_plan(lasting.plan))
    registers = lasting.task.cell.speed_registers, lasting.task.cell.acceleration_registers
    assert done == [{"home": False}, registers, "looks"]


def test_a_board_that_nobody_knows_is_named(lasting: LastingCell) -> None:
    with pytest.raises(ImpossibleError, match="board 03-04 was not seen, so its holes are not known"):
        _station(lasting.task, Observation(), "03-04/1")


def test_a_way_out_that_there_is_not_is_told_by_what_blocked_the_longest(
    lasting: LastingCell, monkeypatch: pytest.MonkeyPatch
) -> None:
    tried: list[float] = []

    def blocked(*arguments: Any) -> None:
        tried.append(arguments[-1].offset)
        raise ImpossibleError(f"blocked {len(tried)}")

    monkeypatch.setattr("cell.task.resume.plan_retreat", blocked)
    seen = _known(Observation(), lasting.task, read_plan(lasting.plan))
    q = lasting.task.cell.q_start
    run: Any = SimpleNamespace(
        task=lasting.task, q_now=lambda: q, speed=0.5, rest=lambda look, q: Rest(lasting.task, look, q, 0.5)
    )
    with pytest.raises(
        ImpossibleError, match="the start: no; and backing out along the jaws: blocked 1; "
    ) as refused:
        _back_out(run, seen, ImpossibleError("the start: no"))
    assert refused.value.data["back_out"] == "blocked 1"
    assert tried == sorted(tried, reverse=True)
    assert len(set(tried)) == 3


def test_resuming_needs_a_controller(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="--resume needs --port"):
        resume_plan(tmp_path, tmp_path, Console(), WhichCell())


@pytest.mark.parametrize(("off", "touched"), [(0.1, True), (0.2, False)])
def test_a_cube_that_was_taken_from_beside_a_hole_may_touch_the_plate_there(
    off: float, touched: bool
) -> None:
    task = read_task(data_file("scenes/task2.toml"))
    seen = true_look(task)
    T = np.array(_station(task, seen, "01-02/4").T_base_tool[0])
    T[2, 3] += off
    transfer = {"cube": "cube 01-02/4", "from": "beside 01-02/4", "to": "03-04/1"}
    assert (plate_name("01-02") in _touched(task, seen, transfer, T)) is touched


BESIDE = {"cube": "cube 01-02/4", "from": "beside 01-02/4", "to": "03-04/1"}


@pytest.mark.parametrize(
    ("state", "seat", "located", "ends"),
    [
        ("cube", "seated", "nothing shows", "done"),
        ("empty", "unsure", "nothing shows", "stays"),
        ("empty", "unsure", "a cube", "displaced"),
        ("unsure", "off", "a cube", "displaced"),
    ],
)
def test_a_cube_that_was_to_be_taken_from_beside_is_looked_for(
    monkeypatch: pytest.MonkeyPatch, state: Any, seat: Any, located: str, ends: str
) -> None:
    """It was passed over: neither taken again nor avoided, and the run ended well."""
    task = read_task(data_file("scenes/task2.toml"))
    look = true_look(task).with_states({"01-02/4": "empty", "03-04/1": state})
    cube = DisplacedCube(BESIDE["cube"], "01-02/4", frozen(transform(t=(0.3, 0.2, 0.1))))
    recovery, told = Recovery(task, 0), list[str]()
    recovery.assume([cube], look)
    monkeypatch.setattr("cell.task.resume.seated", lambda *_: Seating(seat, "its sides"))
    monkeypatch.setattr(
        "cell.cubes.recovery.locate_displaced", lambda *_: cube if located == "a cube" else located
    )
    run: Any = SimpleNamespace(
        task=task,
        recovery=recovery,
        done={},
        widths={},
        tell=told.append,
        console=SimpleNamespace(step=print),
    )
    _take_stock(run, SimpleNamespace(task={"cubes": [BESIDE]}), look)  # type: ignore[arg-type]
    assert run.done == ({BESIDE["cube"]: "03-04/1"} if ends == "done" else {})
    assert bool(recovery.stuck) is (ends == "stays")
    assert bool(recovery.displaced) is (ends == "displaced")
    assert bool(told) is (ends == "stays")


def test_a_cube_from_beside_that_was_released_before_the_stop_is_judged_at_its_target(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    task = read_task(data_file("scenes/task2.toml"))
    look = true_look(task).with_states({"01-02/4": "empty", "03-04/1": "unsure"})
    monkeypatch.setattr("cell.task.resume.seated", lambda *_: Seating("off", "it leans"))
    run: Any = SimpleNamespace(task=task, recovery=Recovery(task, 0), done={}, widths={})
    plan: Any = SimpleNamespace(task={"cubes": [BESIDE]})
    with pytest.raises(ExecutionStopped, match="is not confirmed in 03-04/1: that hole looks unsure"):
        _take_stock(run, plan, look)
