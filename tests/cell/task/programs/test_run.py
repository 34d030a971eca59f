"""Programs are run as tasks are: look, plan, execute; and what a graded run would record is in the report."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from arm.errors import ImpossibleError
from arm.io.storage import data_file
from arm.plan_file import Plan, read_plan
from arm.se3 import apply
from cell.commands.run import run_task
from cell.console import Console
from cell.program.planning import plan_of_program
from cell.program.program_file import ProgramTask, read_program
from cell.session.connection import WhichCell, simulated_cell
from cell.sim.touches import Touches
from driver.emulator.unit.record import Record
from typed.command_line import a465
from vision.observation import Observation

PROGRAM = data_file("scenes/hoop/a.toml")


@cache
def _planned() -> tuple[ProgramTask, Plan]:
    task = read_program(PROGRAM)
    return task, plan_of_program(task, Observation(), 1.0)


def _recorded(world: Path) -> Touches:
    """What an arm without lag that follows the plan records in this world."""
    task, plan = _planned()
    simulated = simulated_cell(task, world)
    counts = [np.rint(move.path.sample(1e-3)[1:]).astype(np.int64) for move in plan.moves]
    times = np.arange(1, sum(map(len, counts)) + 1)
    simulated.record = lambda after_ms: Record(times, np.concatenate(counts))
    (found,) = simulated.touches()
    assert simulated.touches()[0] is found  # judged once
    return found


def _world(folder: Path, keys: str) -> Path:
    file = folder / "some.world.toml"
    file.write_text(f"boards = []\n{keys}")
    return file


@pytest.mark.slow
def test_a_ring_led_along_its_wire_never_touches_it(tmp_path: Path) -> None:
    _, plan = _planned()
    least = min(move.clearance for move in plan.moves if move.threaded)
    found = _recorded(_world(tmp_path, ""))
    assert (found.wire, found.count, found.seconds) == ("a", 0, 0.0)
    assert found.least is not None
    assert found.least > least - 1e-4
    true_ring = _recorded(_world(tmp_path, "[tool]\nring_mm = [60, 69.6, 6.6]\n"))
    assert true_ring.least is not None
    assert found.least < true_ring.least < found.least + 0.0045  # tori are thicker than the ring


@pytest.mark.slow
@pytest.mark.parametrize(
    "keys",
    [
        "[work]\noff_mm = [0, 26, 0]\n",
        *(
            pytest.param(keys, marks=pytest.mark.slow)
            for keys in ("[tool]\noff_mm = [0, 26, 0]\n", "[arm]\nsag_deg = [2, 2]\n")
        ),
    ],
)
def test_a_ring_that_is_not_where_it_should_be_touches_the_wire(tmp_path: Path, keys: str) -> None:
    found = _recorded(_world(tmp_path, keys))
    assert found.count >= 1
    assert found.seconds > 0.1
    assert found.least == 0.0


@pytest.mark.slow
def test_a_program_on_a_board_is_run_by_one_command(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    task = data_file("scenes/hoop/seen.toml")
    report = run_task(task, Console(), WhichCell(time_scale=100.0), tmp_path / "run")
    (wire,) = report["wires"]
    assert (wire["wire"], wire["touches"], wire["touch_s"]) == ("b", 0, 0.0)
    plan = read_plan(tmp_path / "run/plan.json")
    assert wire["least_mm"] > 1e3 * min(move.clearance for move in plan.moves) - 0.2
    assert report["plan_sha256"] == plan.sha256
    said = capsys.readouterr().out
    for words in ("foreseen: ", "look from q_start: 01-02", "planned Wire B on its board", "done: 4 moves"):
        assert words in said
    assert "wire b: never touched; the ring came within" in said
    assert json.loads((tmp_path / "run/report.json").read_text())["wires"] == [wire]
    assert "touches of wire b (truth)" in (tmp_path / "run/report.html").read_text()
    a465("check", "run/plan.json", task)
    # where the board was seen is where the plan has the wire
    bar = next(b for b in plan.scene["bodies"] if b["name"] == "bar 1")
    at = apply(np.array(bar["T_base_body"]), [0.0, 0.0, 0.0])
    assert at[:2] == pytest.approx([0.470, 0.020], abs=2e-3)


@pytest.mark.slow
def test_a_program_that_cannot_be_planned_is_refused_before_anything_moves(tmp_path: Path) -> None:
    text = PROGRAM.read_text().replace("origin_mm = [460, 0, 33]", "origin_mm = [1500, 0, 33]")
    text = text.replace('"cell.toml"', f'"{PROGRAM.parent}/cell.toml"')
    for name in ("wires/a.toml", "board.toml"):
        text = text.replace(f'"{name}"', f'"{PROGRAM.parent}/{name}"')
    (tmp_path / "far.toml").write_text(text)
    with pytest.raises(ImpossibleError, match="out of reach"):
        run_task(tmp_path / "far.toml", Console(as_json=True), WhichCell(time_scale=100.0), tmp_path / "run")
    sent = (tmp_path / "run/wire.jsonl").read_text()
    assert "COORDSPLINET" not in sent
    assert "HH" not in sent


def test_a_plan_that_does_not_state_where_its_ring_is_threaded_is_refused() -> None:
    from cell.task.plan_matches import replayed

    task, plan = _planned()
    assert len(replayed(task, plan)) == 4
    hidden = replace(plan, steps=tuple(replace(move, threaded=None) for move in plan.moves))
    with pytest.raises(
        ImpossibleError, match="states a threaded ring for moves on none; the program asks for a, a"
    ):
        replayed(task, hidden)
