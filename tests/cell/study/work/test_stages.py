"""Each stage is asked of what passed the one before, and says what its own command says."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import pytest

from arm.errors import ExecutionStopped, ImpossibleError, InputError
from cell.files.study import Study, read_study
from cell.study.answer.answers import columns
from cell.study.question.scratch import bundle_of
from cell.study.work.stages import Evaluator, reason_of
from studies.written import YAW, X, write_study
from typed.command_line import a465


def rows_of(study: Study, first: int, count: int) -> list[dict[str, str]]:
    """The rows of some points by column."""
    table = Evaluator(bundle_of(study)).table(first, count)
    return [dict(zip(columns(study), row, strict=True)) for row in csv.reader(table.splitlines())]


@pytest.mark.slow
def test_points_end_as_their_own_command_does(scenes: Path, tmp_path: Path) -> None:
    """Reach and plan of each point, against `a465 plan` on its files."""
    file = write_study(scenes, [X, YAW], points=8, seed=5, stages=["reach", "plan"])
    rows = rows_of(read_study(file), 0, 8)
    assert {row["ok"] for row in rows} == {"0", "1"}
    for row in rows:
        folder = tmp_path / row["point"]
        code = 0 if row["ok"] == "1" else 3
        said, _ = a465("study", file, "--point", row["point"], "-o", folder, "--json", code=code)
        found = json.loads(said)
        if code:
            assert row["detail"][:60] in found["error"]["message"]
            continue
        assert float(row["motion_s"]) == pytest.approx(found["motion_s"], abs=1e-5)
        assert float(row["clearance_mm"]) == pytest.approx(found["min_clearance_mm"], abs=1e-5)


def test_a_later_stage_is_asked_of_what_passed(scenes: Path) -> None:
    far = {"key": "boards[1].centre_mm[0]", "values": [460.0, 900.0]}
    rows = rows_of(read_study(write_study(scenes, [far], stages=["reach", "look"])), 0, 2)
    assert [(row["stage"], row["ok"]) for row in rows] == [("look", "1"), ("reach", "0")]
    assert rows[1]["reason"] == "beyond the arm's reach"


@pytest.mark.slow
def test_a_board_out_of_view_is_told(scenes: Path) -> None:
    away = {"key": "boards[1].centre_mm[1]", "values": [-330.0, -130.0]}
    rows = rows_of(read_study(write_study(scenes, [away], stages=["look"])), 0, 2)
    assert [row["ok"] for row in rows] == ["0", "1"]
    assert rows[0]["reason"] == "view: board 03-04"


def test_a_wrong_value_is_told_for_its_point(scenes: Path) -> None:
    tilt = {"key": "boards[1].tilt_deg", "values": [15.0, 75.0]}
    rows = rows_of(read_study(write_study(scenes, [tilt])), 0, 2)
    assert [(row["ok"], row["reason"]) for row in rows] == [("1", ""), ("0", "wrong value")]
    assert rows[1]["detail"].startswith("task2.world.toml: boards[1].tilt_deg = 75")


@pytest.mark.parametrize(
    ("error", "reason"),
    [
        (ImpossibleError("x", holes=[{"outside_mm": 3.0}]), "beyond the arm's reach"),
        (ImpossibleError("x", holes=[{"joint": "J3", "excess_deg": 1.0}]), "joint J3 beyond its limit"),
        (ImpossibleError("x", holes=[{"racing": "J5"}]), "joint J5 too fast"),
        (ImpossibleError("x", pair=["plate 03-04", "cube 01-02/3"]), "clearance: cube 01-02 and plate 03-04"),
        (ImpossibleError("x", pair=["a", "b"], required_mm=2.0), "clearance with the arm's errors: a and b"),
        (ImpossibleError("x", moved_mm=3.0, scale=0.0), "camera moved"),
        (
            ImpossibleError("x", board="01-02", height=0.1),
            "board 01-02 not as high and flat as the task says",
        ),
        (ImpossibleError("x", board="01-02", why="hidden"), "view: board 01-02"),
        (
            ExecutionStopped("x", cubes=[{"placed": True}, {"placed": False, "faults": ["not gripped"]}]),
            "cube not gripped",
        ),
        (ExecutionStopped("x", cubes=[{"placed": False, "faults": []}]), "cube not seated"),
        (ImpossibleError("x", below_mm={}), "below the table"),
        (ImpossibleError("x"), "refused"),
        (InputError("x"), "wrong value"),
    ],
)
def test_reasons_are_few(error: ImpossibleError, reason: str) -> None:
    assert reason_of(error) == reason


def test_an_error_budget_is_told_as_one() -> None:
    """With the data that `require_insertion` gives."""
    error = ImpossibleError("x", cube="cube 01-02/1", hole="03-04/1", insertion=0.4, sideways_mm=2.0)
    assert reason_of(error) == "error budget"
    assert reason_of(ImpossibleError("x", cubes=4, places=["03-04/1"])) == "too few free holes"


def test_what_says_nothing_of_the_point_ends_its_chunk(scenes: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """An interrupt, and a file that cannot be written, are no refusals."""
    evaluator = Evaluator(bundle_of(read_study(write_study(scenes, points=2, stages=["run"]))))
    full = InputError("log: cannot be written: No space left on device")
    full.__cause__ = OSError(28, "No space left on device")

    def runs(error: Exception) -> None:
        def run_task(*_: object) -> None:
            raise error

        monkeypatch.setattr("cell.study.work.stages.run_task", run_task)

    runs(ExecutionStopped("interrupted", reason="interrupted"))
    with pytest.raises(KeyboardInterrupt):
        evaluator.table(0, 1)
    runs(full)
    with pytest.raises(InputError, match="No space left"):
        evaluator.table(0, 1)
    runs(ExecutionStopped("the jaws hold nothing", reason="gripper"))
    assert "stopped: gripper" in evaluator.table(0, 1)


@pytest.mark.slow
def test_a_look_asks_for_the_error_budget_as_its_command_does(scenes: Path) -> None:
    here = scenes / "realistic"
    seed = {"file": "task", "key": "seed", "values": [0, 1]}
    study = read_study(write_study(here, [seed], stages=["look"]))
    (row,) = rows_of(study, 0, 1)
    assert row["ok"] == "1"
    assert 0.5 < float(row["insertion"]) <= 1.0
    text = (here / "cell.toml").read_text()
    (here / "cell.toml").write_text(
        f"{text}\n[accuracy]\nleast_insertion = 0.9999999\ntool_within_mm = 1.5\n"
    )
    (row,) = rows_of(study, 0, 1)
    assert (row["ok"], row["reason"]) == ("0", "error budget")
    _, told = a465("look", here / "task2.toml", code=3)
    assert row["detail"][:60] in told


def test_its_files_are_gone_with_it(scenes: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    evaluator = Evaluator(bundle_of(read_study(write_study(scenes, points=2))))
    inside = [path for path in tmp_path.iterdir() if path.name.startswith(".study.")]
    assert len(inside) == 1
    assert evaluator.study.file.is_relative_to(inside[0])
    del evaluator
    assert not inside[0].exists()
