"""Placed means seen: whole runs in which a cube is let go badly, and what the look after it makes of it."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from arm.errors import ExecutionStopped
from arm.io.storage import data_file
from cell.cubes.confirm_placed import Release, Unconfirmed, confirm
from cell.cubes.held_back import HeldBack
from cell.files.world import read_world
from cell.report.cubes import CubeRow
from tasks.small import quick_scenes, small_scenes
from tasks.whole_run import WholeRun, run_whole
from typed.command_line import replace_in
from vision.observation import Observation
from vision.occupancy.seated import CubeWidth

pytestmark = pytest.mark.xdist_group("confirming")
UNSEATED = ("high", "half", "rim", "aside")


def _run(tmp_path: Path, releases: list[str], look_after: str = "each") -> WholeRun:
    scenes = quick_scenes(tmp_path, 1, 3)
    world = scenes / "task2.world.toml"
    world.write_text(f"releases = {json.dumps(releases)}\n" + world.read_text())
    with (scenes / "cell.toml").open("a") as cell:
        cell.write("\n[recovery]\nattempts = 0\n")
    replace_in(scenes / "task2.toml", 'look_after = "each"', f'look_after = "{look_after}"')
    return run_whole(scenes / "task2.toml", tmp_path / "run")


@pytest.mark.slow
@pytest.mark.parametrize("release", UNSEATED)
def test_a_cube_that_does_not_sit_stops_the_run_as_not_confirmed(tmp_path: Path, release: str) -> None:
    run = _run(tmp_path, [release])
    assert isinstance(run.error, ExecutionStopped), run.said
    assert run.error.exit_code == 4
    (cube,) = run.error.data["cubes"]
    assert not cube["placed"]
    assert "not confirmed" in str(run.error)
    assert "correct or remove that cube, and run again" in str(run.error)
    assert "not seen" not in str(run.error)  # it is: beside where it should be
    assert "planned s" in run.said
    assert "not confirmed" in cube["remarks"][-1]
    picture = cube["remarks"][-1].split("(see ")[1].rstrip(")")
    assert (run.folder / picture).is_file()


@pytest.mark.slow
@pytest.mark.parametrize("look_after", ["each", "never"])
def test_the_last_cube_is_looked_at_too(tmp_path: Path, look_after: str) -> None:
    run = _run(tmp_path, ["seated", "high"], look_after)
    assert isinstance(run.error, ExecutionStopped), run.said
    assert [c["placed"] for c in run.error.data["cubes"]] == [True, False]
    assert "not confirmed" in str(run.error)


@pytest.mark.slow
def test_a_cube_whose_board_was_pushed_is_not_confirmed_and_the_rest_goes_on(tmp_path: Path) -> None:
    run = _run(tmp_path, ["pushed"])
    assert isinstance(run.error, ExecutionStopped), run.said
    cubes = run.error.data["cubes"]
    assert [c["placed"] for c in cubes] == [False, True]
    assert "board 03-04 moved by 12" in cubes[0]["remarks"][-1]
    assert "1 of 2 cubes not confirmed" in str(run.error)
    assert len(run.error.data["plans_sha256"]) == 2  # what is left was planned from what was seen


@pytest.mark.slow
def test_cubes_that_sit_are_confirmed(tmp_path: Path) -> None:
    run = _run(tmp_path, [])
    assert run.error is None, run.said
    assert [c["placed"] for c in run.report["cubes"]] == [True] * 2


def test_a_world_file_names_how_cubes_are_released(tmp_path: Path) -> None:
    from arm.errors import InputError

    world = small_scenes(tmp_path) / "task2.world.toml"
    world.write_text('releases = ["thrown"]\n' + world.read_text())
    with pytest.raises(InputError, match="releases") as refused:
        read_world(world, 0.036)
    assert "high, half, rim, aside" in str(refused.value)
    assert read_world(data_file("scenes/task2.world.toml"), 0.036).releases == ()


@pytest.mark.parametrize(
    ("source", "target", "sits", "reasons", "lost"),
    [
        ("empty", "cube", "seated", (), False),
        ("cube", "cube", "seated", ("hole a/1 looks cube, not empty",), True),
        (None, "cube", "seated", ("hole a/1 looks hidden, not empty",), True),
        ("unsure", "cube", "seated", ("hole a/1 looks unsure, not empty",), True),
        ("empty", "empty", "seated", ("hole b/2 looks empty, not cube",), True),
        ("empty", "unsure", "seated", ("hole b/2 looks unsure, not cube",), True),
        ("empty", None, "seated", ("hole b/2 looks hidden, not cube",), True),
        ("empty", "cube", "off", ("the cube in b/2 is not certainly seated: because",), True),
        ("empty", "cube", "unsure", ("the cube in b/2 is not certainly seated: because",), True),
    ],
)
def test_each_rule_alone_leaves_a_cube_unconfirmed(
    monkeypatch: pytest.MonkeyPatch,
    source: str | None,
    target: str | None,
    sits: str,
    reasons: tuple[str, ...],
    lost: bool,
) -> None:
    monkeypatch.setattr(
        "cell.cubes.confirm_placed.seated", lambda *_: SimpleNamespace(state=sits, reason="because")
    )
    looks: Any = SimpleNamespace(state={"a/1": source, "b/2": target}.get, board=lambda name: None, images=())
    on_board: Any = SimpleNamespace(to_board="b")
    found = confirm(on_board, looks, looks, "a/1", "b/2", None)
    assert found == (Unconfirmed(reasons, lost) if reasons else None)


@pytest.mark.parametrize(("source", "lost"), [("empty", False), ("cube", True)])
def test_a_place_on_the_table_that_no_look_shows_confirms_nothing(source: str, lost: bool) -> None:
    """The cube has surely left its hole, or else it may be anywhere."""
    looks: Any = SimpleNamespace(state={"a/1": source}.get, board=lambda name: None, images=())
    on_table: Any = SimpleNamespace(to_board=None)
    found = confirm(on_table, looks, looks, "a/1", "table/1", None)
    assert found is not None
    assert found.lost is lost
    assert found.reasons[-1].startswith("table/1 ")
    assert found.reasons[:-1] == (("hole a/1 looks cube, not empty",) if lost else ())


@pytest.mark.parametrize(("known", "beyond"), [(True, True), (True, False), (False, True)])
def test_a_cube_that_sits_on_a_board_that_was_pushed_is_not_confirmed_and_not_lost(
    monkeypatch: pytest.MonkeyPatch, known: bool, beyond: bool
) -> None:
    """Where the board is not in one of both looks, nobody can tell that it moved."""
    shift = SimpleNamespace(beyond=lambda cell: beyond)
    monkeypatch.setattr(
        "cell.cubes.confirm_placed.seated", lambda *_: SimpleNamespace(state="seated", reason="")
    )
    monkeypatch.setattr("cell.cubes.confirm_placed.board_shift", lambda *_: shift)
    pose = SimpleNamespace(board=None, T_base_board=None)
    asked: list[str] = []

    def look(boards: bool) -> Any:
        def board(name: str) -> Any:
            asked.append(name)
            return SimpleNamespace(pose=pose) if boards else None

        return SimpleNamespace(state={"a/1": "empty", "b/2": "cube"}.get, board=board, images=())

    task: Any = SimpleNamespace(to_board="b", cell=SimpleNamespace(cube_size=0.04))
    found = confirm(task, look(known), look(True), "a/1", "b/2", None)
    assert asked == ["b", "b"]
    assert (found is None) is not (known and beyond)
    assert found is None or (not found.lost and found.reasons[0].startswith("board b moved by "))


@pytest.mark.parametrize("moved", [True, False])
@pytest.mark.parametrize("known", [True, False])
def test_a_cube_is_not_measured_in_photographs_that_show_its_source_as_it_was_before(
    monkeypatch: pytest.MonkeyPatch, moved: bool, known: bool
) -> None:
    """Where no look came in between, they show the cube that stood there then: another, or none."""
    measured, before_known = CubeWidth(0.041, 5e-5), CubeWidth(0.0395, 5e-5) if known else None
    used: list[CubeWidth | None] = []

    def confirm(*arguments: Any) -> None:
        used.append(arguments[5])

    monkeypatch.setattr("cell.cubes.confirm_placed.width_at", lambda *_: measured)
    monkeypatch.setattr("cell.cubes.confirm_placed.confirm", confirm)
    task: Any = SimpleNamespace()
    before: Any = SimpleNamespace(moved_since=frozenset({"a/1"} if moved else {"a/2", "b/1"}))
    row = CubeRow("a/1", "b/2")
    for source, disturbed in (("a/1", False), ("a/1", True), ("beside b/2", False)):
        release = Release(row, source, "b/2", before, np.eye(4), before_known, disturbed=disturbed)
        judged, why = release.judge(task, before)
        assert why is None
        assert judged.width is used[-1]
        seated = not (moved or disturbed or source != "a/1")
        assert used.pop() == (measured if seated else before_known)
        assert row.placed


def test_a_cube_that_is_put_back_is_not_placed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("cell.cubes.confirm_placed.confirm", lambda *_: None)
    row, before = CubeRow("a/1", "b/2"), Observation()
    Release(row, "beside b/2", "a/1", before, np.eye(4)).judge(cast(Any, None), before)
    assert not row.placed


@pytest.mark.parametrize(
    ("beside", "state", "confirmed"), [("b/2", "unsure", True), ("a/1", "unsure", False)]
)
def test_a_cube_from_beside_its_target_has_no_source_to_be_empty(
    monkeypatch: pytest.MonkeyPatch, beside: str, state: str, confirmed: bool
) -> None:
    monkeypatch.setattr(
        "cell.cubes.confirm_placed.seated", lambda *_: SimpleNamespace(state="seated", reason="")
    )
    looks: Any = SimpleNamespace(state={"a/1": state, "b/2": "cube"}.get, board=lambda name: None, images=())
    found = confirm(cast(Any, SimpleNamespace(to_board="b")), looks, looks, f"beside {beside}", "b/2", None)
    assert (found is None) is confirmed


@pytest.mark.parametrize("state", ["cube", "empty"])
def test_a_cube_that_is_put_back_from_the_table_is_looked_for_in_its_hole(
    monkeypatch: pytest.MonkeyPatch, state: str
) -> None:
    monkeypatch.setattr(
        "cell.cubes.confirm_placed.seated", lambda *_: SimpleNamespace(state="seated", reason="")
    )
    looks: Any = SimpleNamespace(state={"a/1": state}.get, board=lambda name: None, images=())
    found = confirm(cast(Any, SimpleNamespace(to_board=None)), looks, looks, "beside table/3", "a/1", None)
    assert found == (None if state == "cube" else Unconfirmed(("hole a/1 looks empty, not cube",), True))


@pytest.mark.parametrize("again", [False, True])
@pytest.mark.parametrize("seen", [False, True])
@pytest.mark.parametrize("by", [1e-4, 8e-4])
def test_an_arm_that_was_held_back_needs_two_looks_that_show_the_cube_seated(
    monkeypatch: pytest.MonkeyPatch, by: float, seen: bool, again: bool
) -> None:
    found = None if seen else Unconfirmed(("it is not certainly seated",), True)
    monkeypatch.setattr("cell.cubes.confirm_placed.confirm", lambda *_: found)
    row, before, held = CubeRow("a/1", "b/2"), Observation(), HeldBack(by, 3e-4)
    release = Release(row, "beside b/2", "b/2", before, np.eye(4), held_back=held)
    _, why = release.judge(cast(Any, None), before, again)
    assert row.placed == (why is None) == (seen and (again or not held.by_contact))
    if why is not None:
        assert why.lost
        assert ("held back by 0.8 mm at the release" in why.reasons[0]) == held.by_contact
