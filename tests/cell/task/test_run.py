"""A run of a task: whatever cannot be written, how it ended is told."""

from __future__ import annotations

import errno
import json
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from arm.errors import A465Error, ExecutionStopped, ImpossibleError, InputError
from arm.io.storage import data_file
from arm.plan_file import Move
from arm.se3 import transform
from cell.console import OutputLost
from cell.cubes.recovery import Recovery
from cell.files.task import read_task
from cell.scene.displaced import DisplacedCube
from cell.task.cube_cycles import cube_cycles
from cell.task.planning import Rest
from cell.task.run import TaskRun
from driver.emulator import Emulator
from tasks.full_disks import execute
from tasks.seen_cells import planned
from vision.observation import Observation

pytestmark = pytest.mark.xdist_group("logs")


def test_a_report_that_cannot_be_written_does_not_hide_how_the_run_ended(
    place: Path, emulator: Emulator, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def full(file: Path, _: bytes | str) -> None:
        raise InputError(f"{file}: cannot be written: No space left on device")

    monkeypatch.setattr("cell.task.open_run.write_atomic", full)
    with pytest.raises(A465Error, match="has 0 new images"):
        execute(emulator.open_pty(), place / "images")
    told = capsys.readouterr()
    assert "no report: runs/task2-1/report.json: cannot be written: No space left" in told.err + told.out


def test_an_output_that_is_lost_while_the_end_is_told_does_not_hide_how_the_run_ended(
    place: Path, emulator: Emulator, monkeypatch: pytest.MonkeyPatch
) -> None:
    def lost(run: TaskRun) -> None:
        raise OutputLost(BrokenPipeError(errno.EPIPE, "Broken pipe"))

    def stopped(run: TaskRun, why: str) -> None:
        raise ExecutionStopped("an axis stands still")

    monkeypatch.setattr(TaskRun, "tell_rows", lost)
    monkeypatch.setattr(TaskRun, "try_look", stopped)
    with pytest.raises(ExecutionStopped, match="an axis stands still; the arm has stopped") as ended:
        execute(emulator.open_pty(), place / "images")
    assert not isinstance(ended.value, OutputLost)
    assert json.loads((place / "runs/task2-1/report.json").read_text())["error"]["exit_code"] == 4


@pytest.mark.parametrize("known", [None, 20])
def test_a_run_that_may_recover_takes_the_images_that_suffice_once(
    monkeypatch: pytest.MonkeyPatch, known: int | None
) -> None:
    """The plan for the longer look is judged, too. What a second, longer look does not cure is refused."""
    looks: list[int | None] = []
    judged: list[tuple[Observation, str]] = []
    run = TaskRun.__new__(TaskRun)
    run.recovery, run.photographs, run.remarks = Recovery(cast(Any, None), 3), known, []
    run.console = cast(Any, SimpleNamespace(step=lambda text: None))
    first, longer = Observation(), Observation()
    rest, plan = Rest(cast(Any, None), first, np.zeros(6), 0.5), cast(Any, "plan")

    def require(self: TaskRun, seen: Observation, plan: Any) -> None:
        judged.append((seen, plan))
        if seen is first:
            raise ImpossibleError("too likely to miss", photographs=20)

    def look(self: TaskRun, why: str) -> Observation:
        looks.append(self.photographs)
        return longer

    monkeypatch.setattr(TaskRun, "require_accuracy", require)
    monkeypatch.setattr(TaskRun, "look", look)
    monkeypatch.setattr(TaskRun, "_planned", lambda self, rest: "plan for the longer look")
    run.task = cast(Any, SimpleNamespace(cell=None))
    if known is None:
        assert run._certain(rest, plan) == (longer, "plan for the longer look")
        assert looks == [20]
        assert judged[-1] == (longer, "plan for the longer look")
        assert run._certain(replace(rest, observation=longer), plan) == (longer, plan)
    else:
        with pytest.raises(ImpossibleError, match="too likely to miss"):
            run._certain(rest, plan)
        assert looks == []
    run.recovery.most, run.photographs = 0, None
    with pytest.raises(ImpossibleError, match="too likely to miss"):
        run._certain(rest, plan)


def test_a_cube_that_no_plan_moves_is_tried_again_after_the_others(monkeypatch: pytest.MonkeyPatch) -> None:
    task = read_task(data_file("scenes/task2.toml"))
    cube = DisplacedCube("cube 01-02/4", "01-02/4", transform())
    run, seen, done, told = TaskRun.__new__(TaskRun), Observation(), list[str](), list[str]()
    run.task, run.recovery, run.rows, run.remarks = task, Recovery(task, 3), [], []
    run.console = cast(Any, SimpleNamespace(step=told.append))
    run.recovery.displaced = {cube.name: cube}
    plans: list[Any] = [SimpleNamespace(name="the others"), None, None]

    def blocked(self: TaskRun, cube: DisplacedCube, seen: Observation) -> Any:
        done.append(f"tries {cube.name}")
        if len(done) == 1:
            raise ImpossibleError("another cube is too near")
        return SimpleNamespace(name=cube.name)

    def follow(self: TaskRun, plan: Any, seen: Observation) -> tuple[Observation, bool]:
        done.append(f"moves {plan.name}")
        self.recovery.displaced.pop(plan.name, None)
        return seen, False

    monkeypatch.setattr(TaskRun, "_survey", lambda self, seen: None)
    monkeypatch.setattr(TaskRun, "_plan_recovery", blocked)
    monkeypatch.setattr(TaskRun, "_plan_rest", lambda self, seen: (plans.pop(0), seen))
    monkeypatch.setattr(TaskRun, "follow", follow)
    monkeypatch.setattr(TaskRun, "keep", lambda *_: None)
    monkeypatch.setattr(TaskRun, "rest", lambda *_: None)
    monkeypatch.setattr(Recovery, "locate_again", lambda *_: [])
    monkeypatch.setattr("cell.task.run.hidden_holes", lambda _: [])
    run.move_cubes(seen)
    assert done == [f"tries {cube.name}", "moves the others", f"tries {cube.name}", f"moves {cube.name}"]
    assert told == [
        f"{cube.name} waits beside 01-02/4 until the others are moved: another cube is too near",
    ]
    assert run.rows[0].faults == []


def test_the_cubes_that_a_lift_may_touch_are_told(monkeypatch: pytest.MonkeyPatch) -> None:
    cube, told = DisplacedCube("cube 01-02/4", "03-04/2", transform()), list[str]()
    run = TaskRun.__new__(TaskRun)
    run.task, run.remarks, run.budget = read_task(data_file("scenes/task2.toml")), [], None
    run.console = cast(Any, SimpleNamespace(step=told.append, doing=lambda _: nullcontext()))
    run.recovery = cast(Any, SimpleNamespace(goals=lambda *_: ()))
    lift = SimpleNamespace(clearance=0.001, allowed_collisions=("cube 03-04/1", "plate 03-04"))
    plan = SimpleNamespace(
        task={"cubes": [{"to": "03-04/2"}]}, moves=(lift,), duration_s=1.0, sha256="0123456789abcdef"
    )
    monkeypatch.setattr(TaskRun, "rest", lambda *_: Rest(run.task, Observation(), run.task.cell.q_start, 0.5))
    monkeypatch.setattr(TaskRun, "q_now", lambda _: run.task.cell.q_start)
    monkeypatch.setattr("cell.task.run.plan_recovery", lambda *_: plan)
    monkeypatch.setattr("cell.task.run.spending", lambda _: nullcontext())
    assert run._plan_recovery(cube, Observation()) is cast(Any, plan)
    assert run.remarks == ["cube 01-02/4 is lifted along cube 03-04/1, which it may touch"]


@pytest.mark.parametrize("blocks", [False, True])
def test_a_cube_that_stays_beside_its_seat_is_in_the_report(
    monkeypatch: pytest.MonkeyPatch, blocks: bool
) -> None:
    """Even if nobody tried to move it, or if it keeps all others from moving; so the run does not end well."""
    task = read_task(data_file("scenes/task2.toml"))
    cube = DisplacedCube("cube 01-02/4", "03-04/1", transform())
    run = TaskRun.__new__(TaskRun)
    run.task, run.recovery, run.rows, run.remarks = task, Recovery(task, 3), [], []
    run.console = cast(Any, SimpleNamespace(step=lambda text: None))
    run.recovery.stuck = {cube.name: cube}

    def plan_rest(self: TaskRun, seen: Observation) -> tuple[None, Observation]:
        if blocks:
            raise ImpossibleError("the palm is inside it")
        return None, seen

    for name in ("_survey", "rest"):
        monkeypatch.setattr(TaskRun, name, lambda *_: None)
    monkeypatch.setattr(TaskRun, "_recover", lambda self, seen: seen)
    monkeypatch.setattr(TaskRun, "_plan_rest", plan_rest)
    monkeypatch.setattr("cell.task.run.hidden_holes", lambda _: [])
    run.move_cubes(Observation())
    (row,) = run.rows
    assert (row.source, row.placed, row.at, row.faults) == ("01-02/4", False, "beside 03-04/1", ["stays"])
    assert run.remarks == (["no other cube moves: the palm is inside it"] if blocks else [])
    run.recovery.stuck = {}
    if blocks:
        with pytest.raises(ImpossibleError, match="the palm is inside it"):
            run.move_cubes(Observation())


@pytest.mark.parametrize("helps", [True, False])
def test_what_no_number_of_images_cures_is_looked_at_twice(
    monkeypatch: pytest.MonkeyPatch, helps: bool
) -> None:
    """The cubes in question only, and if that makes them certain enough; a refused clearance is no matter of looks."""
    run, asked = TaskRun.__new__(TaskRun), frozenset(("cube 01-02/2",) if helps else ())
    run.task, run.recovery = cast(Any, SimpleNamespace(cell="cell")), Recovery(cast(Any, None), 3)
    run.photographs, run.remarks, run.budgets = None, [], {}
    run.console = cast(Any, SimpleNamespace(step=lambda text: None))
    rest = Rest(cast(Any, None), Observation(), np.zeros(6), 0.5)
    why: dict[str, Any] = {"insertion": 0.9}

    def refuse(self: TaskRun, seen: Observation, plan: Any) -> None:
        raise ImpossibleError("too likely to miss", **why)

    monkeypatch.setattr(TaskRun, "require_accuracy", refuse)
    monkeypatch.setattr(TaskRun, "_planned", lambda self, rest: ("plan", rest.second_looks))
    monkeypatch.setattr("cell.task.run.second_look_helps", lambda cell, seen, plan: asked)
    monkeypatch.setattr("cell.task.run.plan_budgets", lambda *_: [SimpleNamespace(cube="cube 01-02/2")])
    monkeypatch.setattr("cell.task.run.erring_clearances", lambda *_: ())
    if helps:
        assert run._certain(rest, cast(Any, "plan")) == (rest.observation, ("plan", asked))
        assert list(run.budgets) == ["cube 01-02/2"]
        assert "a second one before the pocket, with cube 01-02/2" in run.remarks[0]
        why.pop("insertion")
    with pytest.raises(ImpossibleError, match="too likely to miss"):
        run._certain(rest, cast(Any, "plan"))
    run.recovery.most = 0
    why["insertion"] = 0.9
    with pytest.raises(ImpossibleError, match="too likely to miss"):
        run._certain(rest, cast(Any, "plan"))


@pytest.mark.parametrize("back", [False, True])
def test_a_release_that_held_the_arm_back_is_looked_at_at_once(
    monkeypatch: pytest.MonkeyPatch, back: bool
) -> None:
    """Also in a plan that never looks: the arm backs out from the release, and the rest is planned again."""
    task = replace(read_task(data_file("scenes/task2.toml")), look_after="never")
    plan, _ = planned(task)
    run, done = TaskRun.__new__(TaskRun), list[str]()
    run.task, run.rows, run.recovery, run.done = task, [], Recovery(task, 3), {}
    width = task.cell.gripper.fraction_closed(task.cell.cube_size)
    held = SimpleNamespace(gripper=SimpleNamespace(stalled=True, fraction_closed=width))
    seen = Observation()

    def back_out(self: TaskRun, q: np.ndarray, line: Move, observation: Observation) -> None:
        release = next(m for m in reversed(cube_cycles(plan)[0].carry) if isinstance(m, Move)).path.end
        assert tuple(task.cell.unit.counts(q)) == line.path.start == release
        done.append("backs out")

    monkeypatch.setattr(TaskRun, "released_held_back", property(lambda self: back))
    monkeypatch.setattr(TaskRun, "execute", lambda self, steps, *_: [held])
    monkeypatch.setattr(TaskRun, "carry", lambda self, *_: bool(done.append("carries")))
    monkeypatch.setattr(TaskRun, "back_out", back_out)
    monkeypatch.setattr(TaskRun, "look", lambda self, why: (done.append(why), seen)[1])
    monkeypatch.setattr(TaskRun, "confirm_placed", lambda self, observation: observation)
    _, again = run.follow(plan, seen)
    if back:
        assert again
        assert done == ["carries", "backs out", "after cube 1, which may not be seated"]
    else:
        assert done == [*["carries"] * 4, "after cube 4"]
