"""A run takes stock of its cubes."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from arm.errors import ExecutionStopped
from arm.io.storage import data_file
from arm.se3 import transform
from cell.cubes.confirm_placed import Release, Unconfirmed
from cell.cubes.held_back import HeldBack
from cell.cubes.recovery import Recovery
from cell.files.task import read_task
from cell.report.cubes import CubeRow
from cell.scene.displaced import DisplacedCube
from cell.task.checked_run import CheckedRun
from cell.task.run import TaskRun
from plan.scene import Scene
from tasks.true_look import true_look
from vision.observation import Observation

TASK = read_task(data_file("scenes/task2.toml"))
TRANSFER = {"cube": "cube 01-02/3", "from": "01-02/3", "to": "03-04/1"}


def _run() -> CheckedRun:
    run = CheckedRun.__new__(CheckedRun)
    run.task, run.speed, run.recovery = TASK, 0.5, Recovery(TASK, 3)
    run.done, run.on_table, run.given_up, run.remarks, run.rows = {}, {}, set(), [], []
    run.console = cast(Any, SimpleNamespace(step=lambda text: None))
    return run


def test_jaws_that_missed_a_cube_and_do_not_open_stop_the_run() -> None:
    """A retract with open jaws would be certified, but they are not open."""
    mars = SimpleNamespace(gripper=lambda closed: SimpleNamespace(stalled=True))
    run = CheckedRun.__new__(CheckedRun)
    run.connection, run.given_up, run.remarks = cast(Any, SimpleNamespace(mars=mars)), set(), []
    run.console = cast(Any, SimpleNamespace(step=lambda text: None))
    with pytest.raises(
        ExecutionStopped, match="missed the cube of 01-02/3 and do not open: something blocks them"
    ):
        run.missed(cast(Any, None), TRANSFER, CubeRow("01-02/3", "03-04/1"), Observation(), "on nothing")


def test_the_way_to_the_start_goes_around_displaced_cubes(monkeypatch: pytest.MonkeyPatch) -> None:
    scenes: list[Scene] = []
    monkeypatch.setattr(CheckedRun, "q_now", lambda self: TASK.cell.q_start)
    monkeypatch.setattr("cell.task.checked_run.plan_motion", lambda task, scene, *_: scenes.append(scene))
    run, seen = _run(), true_look(TASK)
    beside = DisplacedCube("cube 01-02/2", "01-02/2", transform(t=(0.3, 0.1, 0.2)))
    run.recovery.stuck = {beside.name: beside}
    run.go_to_start(seen)
    (scene,) = scenes
    assert scene.cube(beside.name).T_base_body[:3, 3] == pytest.approx([0.3, 0.1, 0.2])


def test_a_lost_cube_does_not_hide_where_the_others_are(monkeypatch: pytest.MonkeyPatch) -> None:
    def stops(self: CheckedRun, release: Release, *_: Any) -> None:
        raise ExecutionStopped("lost")

    def judge(self: Release, *_: Any, again: bool = False) -> tuple[Release, Unconfirmed | None]:
        self.row.placed = self.target == "03-04/2"
        return self, None if self.row.placed else Unconfirmed(("hidden",), True)

    monkeypatch.setattr(CheckedRun, "_not_confirmed", stops)
    monkeypatch.setattr(Release, "judge", judge)
    run, seen = _run(), true_look(TASK)
    run.recovery.most = 0
    rows = [CubeRow("01-02/1", "03-04/1"), CubeRow("01-02/2", "03-04/2")]
    run._released = [Release(r, r.source, r.target, seen, transform()) for r in rows]
    with pytest.raises(ExecutionStopped, match="lost"):
        run.confirm_placed(seen)
    assert [(row.placed, row.at) for row in rows] == [(False, "unknown"), (True, "03-04/2")]


def test_the_row_of_a_cube_is_that_of_its_hole_wherever_it_is_taken_from() -> None:
    row = _run().add_row({"cube": "cube 01-02/3", "from": "beside 03-04/1", "to": "03-04/1"})
    assert (row.source, row.target) == ("01-02/3", "03-04/1")


def test_cubes_that_stay_are_located_again_although_none_is_to_be_taken(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    asked: list[Observation] = []

    def locate_again(self: Recovery, look: Observation) -> list[str]:
        asked.append(look)
        return []

    monkeypatch.setattr(Recovery, "locate_again", locate_again)
    run, seen = TaskRun.__new__(TaskRun), true_look(TASK)
    run.recovery = Recovery(TASK, 3)
    assert run._recover(seen) is seen
    assert asked == [seen]


def test_the_retract_after_a_missed_grasp_is_no_longer_than_the_approach(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Cubes that longer lines do not reach are approached by shorter ones."""
    cell, asked = TASK.cell, list[float]()

    def retreat(scene: Scene, q: Any, unit: Any, limits: Any, options: Any) -> tuple[()]:
        asked.append(options.offset)
        raise ExecutionStopped("far enough")

    monkeypatch.setattr("cell.task.checked_run.plan_retreat", retreat)
    run = _run()
    opens = SimpleNamespace(gripper=lambda closed: SimpleNamespace(stalled=False))
    run.connection = cast(Any, SimpleNamespace(mars=opens))
    q = cell.q_start
    for off in (0.05, 1.0):
        start, end = (cell.unit.counts(at) for at in (q + [off, 0, 0, 0, 0, 0], q))
        cycle: Any = SimpleNamespace(approach=SimpleNamespace(path=SimpleNamespace(start=start, end=end)))
        with pytest.raises(ExecutionStopped, match="far enough"):
            run.missed(cycle, TRANSFER, CubeRow("01-02/3", "03-04/1"), true_look(TASK), "on nothing")
    x, y = cell.robot().T_base_tool(q)[:2, 3]
    assert asked == [pytest.approx(2.0 * np.hypot(x, y) * np.sin(0.025), abs=1e-5), cell.offset]


def test_the_look_in_which_a_cube_is_searched_is_not_the_one_of_the_empty_place(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A hole with a cube beside it looks empty: compared with itself, the image shows no cube."""
    first, look = true_look(TASK), true_look(TASK)
    run, asked = _run(), list[Observation | None]()
    run.pictures, run._released = [cast(Any, SimpleNamespace(file=SimpleNamespace(name="look-2.png")))], []
    run.recovery.keep_empty(first)
    release = Release(CubeRow("01-02/3", "03-04/1"), "01-02/3", "03-04/1", first, transform())
    monkeypatch.setattr(
        Release, "judge", lambda self, *_, again=False: (self, Unconfirmed(("not there",), True))
    )
    monkeypatch.setattr(CheckedRun, "look", lambda *_: look)
    monkeypatch.setattr(CheckedRun, "_stop", lambda self, why: pytest.fail(why))
    beside = DisplacedCube("cube 01-02/3", "03-04/1", look.boards[1].pose.holes[0].T_base_hole)

    def locate(*given: Any) -> DisplacedCube:
        asked.append(given[-1])
        return beside

    monkeypatch.setattr("cell.cubes.recovery.locate_displaced", locate)
    run._released = [release]
    run.confirm_placed(look)
    assert asked == [first]
    assert run.recovery.empty_look("03-04/1") is first


@pytest.mark.parametrize(("most", "looks", "placed"), [(3, 1, True), (0, 0, True)])
def test_a_cube_that_held_the_arm_back_is_looked_at_once_more(
    monkeypatch: pytest.MonkeyPatch, most: int, looks: int, placed: bool
) -> None:
    """Two looks that show it seated confirm it; a run without attempts believes the first one."""
    monkeypatch.setattr("cell.cubes.confirm_placed.confirm", lambda *_: None)
    monkeypatch.setattr("cell.cubes.confirm_placed.width_at", lambda *_: None)
    asked: list[str] = []
    run, seen = _run(), true_look(TASK)
    run.recovery.most = most
    run.look = lambda why: (asked.append(why), seen)[1]  # type: ignore[method-assign, func-returns-value]
    row = CubeRow("01-02/1", "03-04/1")
    free, pressed = HeldBack(1e-4, 3e-4), HeldBack(8e-4, 3e-4)
    run._released = [Release(row, row.source, row.target, seen, transform(), held_back=free)]
    assert not run.released_held_back
    run._released = [Release(row, row.source, row.target, seen, transform(), held_back=pressed)]
    assert run.released_held_back
    run.confirm_placed(seen)
    assert (len(asked), row.placed) == (looks, placed)
    assert row.remarks == [f"{pressed.words()}; but the look shows it seated"]
    assert not run.released_held_back
