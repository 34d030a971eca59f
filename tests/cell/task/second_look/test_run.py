"""Whole runs in a realistic cell whose target board slides after the cube was taken: told, and the cube is seated."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from arm.io.storage import data_file
from arm.plan_file import LookStep
from tasks.small import leave_cubes
from tasks.whole_run import WholeRun, run_whole
from typed.command_line import replace_in

pytestmark = [pytest.mark.slow, pytest.mark.xdist_group("second_looks")]


def _run(
    tmp_path: Path,
    when: str,
    slid_mm: tuple[float, float],
    after: int = 1,
    into: int = 1,
    release: str = "seated",
    attempts: int = 3,
) -> WholeRun:
    """One cube goes into hole `into` of the board that slides after a grasp."""
    scenes = Path(shutil.copytree(data_file("scenes"), tmp_path / "scenes")) / "realistic"
    leave_cubes(scenes, 4)
    world = scenes / "task2.world.toml"
    replace_in(world, "tilt_deg = 15", f"tilt_deg = 15\nshifts_mm = {list(slid_mm)}\nshifts_after = {after}")
    world.write_text(f'releases = ["{release}"]\n' + world.read_text())
    replace_in(scenes / "task2.toml", "to_board = [3, 4]", f"to_board = [3, 4]\nto_holes = [{into}]")
    replace_in(scenes / "cell.toml", "[look]\n", f'[look]\nsecond = "{when}"\n')
    replace_in(scenes / "cell.toml", "speed = 0.5", "speed = 1.0")
    with (scenes / "cell.toml").open("a") as cell:
        cell.write(f"\n[recovery]\nattempts = {attempts}\n")
    return run_whole(scenes / "task2.toml", tmp_path / "run")


def _last(run: WholeRun) -> str:
    assert run.simulated is not None
    return run.simulated.events[-1].what


@pytest.mark.parametrize("slid_mm", [(3.0, 0.0), (0.0, -4.0)])
def test_a_board_that_slid_is_told_and_the_cube_seated_where_it_is_now(
    tmp_path: Path, slid_mm: tuple[float, float]
) -> None:
    run = _run(tmp_path, "each", slid_mm)
    assert run.error is None, run.said
    (row,) = run.report["cubes"]
    assert (row["placed"], _last(run), run.report["second_looks"]) == (True, "placed", 1)
    by = max(map(abs, slid_mm))
    assert f"board 03-04 has moved by {by:.1f} mm" in run.said
    assert "the last part is planned again" in run.said
    assert row["error_mm"] < 0.6


def test_without_the_second_look_the_cube_does_not_seat(tmp_path: Path) -> None:
    run = _run(tmp_path, "never", (3.0, 0.0), attempts=0)
    assert run.error is not None
    assert _last(run) == "unseated"


def test_what_the_arm_hides_is_looked_at_from_the_start_with_the_cube_in_the_jaws(tmp_path: Path) -> None:
    run = _run(tmp_path, "each", (3.0, 0.0), into=4)
    assert run.error is None, run.said
    assert "does not show board 03-04: neither of its markers" in run.said
    assert "taken back to q_start in the jaws" in run.said
    assert (run.report["cubes"][0]["placed"], _last(run)) == (True, "placed")
    assert run.report["cubes"][0]["error_mm"] < 0.8


def test_a_board_at_rest_is_looked_at_and_nothing_else_changes(tmp_path: Path) -> None:
    run = _run(tmp_path, "each", (0.0, 0.0))
    assert run.error is None, run.said
    assert "second look: board 03-04 is off by" in run.said
    assert sorted(path.stem for path in run.folder.glob("*.json")) == ["plan", "report", "to-start"]
    assert sum(isinstance(step, LookStep) and step.cube == 0 for step in run.plan().steps) == 1


def test_a_recovery_from_the_target_board_looks_without_being_told_to(tmp_path: Path) -> None:
    """The first release leaves the cube leaning; the jaws that take it again move the board."""
    run = _run(tmp_path, "asked", (3.0, -1.5), after=2, release="half")
    assert run.error is None, run.said
    assert run.report["second_looks"] == 1
    assert "board 03-04 has moved by" in run.said
    assert (run.report["cubes"][0]["placed"], _last(run)) == (True, "placed")


def test_without_attempts_the_arm_rests_with_the_cube_and_says_where_the_board_is(tmp_path: Path) -> None:
    run = _run(tmp_path, "each", (3.0, 0.0), attempts=0)
    assert run.error is not None
    assert "board 03-04 has moved by 3.0 mm" in str(run.error)
    assert run.error.data["holding"] == "cube 01-02/4"
    assert _last(run) == "gripped"
