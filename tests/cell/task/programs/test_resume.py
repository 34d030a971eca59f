"""A program that was stopped goes on along the same path, or says in one line what to do."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from arm.errors import ImpossibleError
from arm.io.storage import data_file
from arm.plan_file import Move, Plan, read_plan, write_plan
from cell.program.planning import plan_of_program
from cell.program.program_file import ProgramTask, read_program
from cell.task.programs.resume import stopped_in
from cell.task.programs.run import ProgramRun
from programs.lasting import Lasting
from vision.observation import Observation

PROGRAM = data_file("scenes/hoop/b.toml")
SPEED = 1.0
pytestmark = pytest.mark.xdist_group("resume")


@cache
def _planned() -> tuple[ProgramTask, Plan]:
    task = read_program(PROGRAM)
    return task, plan_of_program(task, Observation(), SPEED)


@pytest.mark.slow
def test_the_report_beside_a_plan_says_in_which_step_it_was_stopped(tmp_path: Path) -> None:
    _, plan = _planned()
    file = tmp_path / "report.json"
    assert stopped_in(file, plan) is None
    for error, index in (
        ({"index": 2, "plan_sha256": plan.sha256}, 2),
        ({"index": 2, "plan_sha256": "another"}, None),
        ({"index": 99, "plan_sha256": plan.sha256}, None),
        ({}, None),
    ):
        file.write_text(json.dumps({"error": error}))
        assert stopped_in(file, plan) == index
    file.write_text("[")
    assert stopped_in(file, plan) is None


@pytest.fixture
def lasting(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Lasting]:
    found = Lasting(tmp_path, monkeypatch, *_planned())
    with found.emulator:
        yield found


@pytest.mark.slow
def test_stopped_on_the_wire_again_and_again_the_ring_comes_off_over_the_free_end(
    lasting: Lasting, capsys: pytest.CaptureFixture[str]
) -> None:
    at = lasting
    plan = at.stopped(at.first, "along wire B", 0.4)
    plan = at.stopped(lambda: at.resumed(plan, "second"), "along wire B", 0.1)
    plan = at.stopped(lambda: at.resumed(plan, "third"), "back along wire B", 0.5)
    report = at.resumed(plan, "fourth")
    said = capsys.readouterr().out
    assert said.count("it goes on in 'along wire B'") == 2
    assert said.count("it goes on in 'back along wire B'") == 1
    assert "to go on: a465 execute" in said
    (wire,) = report["wires"]
    assert (wire["wire"], wire["touches"]) == ("b", 0)
    assert at.emulator.violations == ()
    np.testing.assert_allclose(at.task.cell.unit.positions(at.emulator.counts()), at.task.q_end, atol=1e-3)
    assert all(m.certified for f in at.folder.glob("*/plan.json") for m in read_plan(f).moves)


@pytest.mark.slow
def test_an_arm_that_is_not_on_the_path_begins_anew_if_it_can_and_tells_a_cure_if_not(
    lasting: Lasting, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def blocked(run: ProgramRun, observation: Observation) -> None:
        raise ImpossibleError("the ring is on the wire")

    at = lasting
    plan = at.stopped(at.first, "to wire B", 0.5)
    monkeypatch.setattr("cell.task.programs.resume.NEAR", -1.0)
    with monkeypatch.context() as on_wire:
        on_wire.setattr(ProgramRun, "go_to_start", blocked)
        told = "deg from the path of the plan, and no certified motion leads from there to q_start: the ring is on"
        with pytest.raises(
            ImpossibleError, match=f"{told} the wire; take the tool clear of the workpiece by hand"
        ):
            at.resumed(plan, "second")
    report = at.resumed(plan, "third")
    assert "it begins anew from q_start" in capsys.readouterr().out
    assert report["wires"][0]["touches"] == 0


@pytest.mark.slow
def test_a_plan_that_does_not_hold_is_refused_before_the_port_is_opened(lasting: Lasting) -> None:
    """The arm may begin anew on all of a plan, so all of it is certified again: here the ring leaves its wire."""
    whole, plan = read_plan(lasting.plan), lasting.folder / "bare.json"
    steps = tuple(replace(s, threaded=None) if isinstance(s, Move) else s for s in whole.steps)
    write_plan(plan, replace(whole, steps=steps))
    with pytest.raises(ImpossibleError, match="states a threaded ring for moves on none"):
        lasting.resumed(plan, "first")
    assert not (lasting.folder / "first").exists()


@pytest.mark.slow
def test_a_unit_that_lost_its_positions_is_not_homed_with_a_ring_on_the_wire(lasting: Lasting) -> None:
    with pytest.raises(
        ImpossibleError, match="before it is homed, take the tool clear of the workpiece by hand"
    ):
        lasting.resumed(lasting.plan, "first")  # it never was homed
    assert "HH" not in (lasting.folder / "first/wire.jsonl").read_text()
