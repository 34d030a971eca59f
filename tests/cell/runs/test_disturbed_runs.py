"""Whole runs in a cell that does not stay as it was seen: cubes that go, boards that move, jaws that fail."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from arm.errors import ExecutionStopped
from arm.se3 import transform
from cell.files.world import board_placement
from cell.session.connection import Connection
from tasks.small import quick_scenes
from tasks.whole_run import run_whole

pytestmark = pytest.mark.xdist_group("disturbed_runs")


@pytest.fixture(scope="module")
def task2(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The task that all these runs begin to do; nothing changes its files."""
    scenes = quick_scenes(tmp_path_factory.mktemp("disturbed"), 1, 3)
    with (scenes / "cell.toml").open("a") as cell:
        cell.write("\n[recovery]\nattempts = 0\n")  # test_recovered_runs.py is about them
    return scenes / "task2.toml"


@pytest.mark.slow
def test_a_board_that_moves_on_the_way_makes_the_rest_be_planned_anew(task2: Path, tmp_path: Path) -> None:
    def meddle(connection: Connection) -> None:
        simulated, grab, looks = connection.simulated, connection.frames.grab, [0]
        assert simulated is not None

        def pushed(count: int) -> list[np.ndarray]:
            looks[0] += 1
            if looks[0] == 3:  # between the first cube and the look after it, board and cube are pushed
                push = transform(t=(0.006, -0.004, 0.0))
                source, target = simulated.world.boards
                target = replace(target, T_base_board=push @ target.T_base_board)
                simulated.world = replace(simulated.world, boards=(source, target))
                moved = next(i for i, c in enumerate(simulated._cubes) if c.name == simulated.events[-1].cube)
                simulated._cubes[moved] = replace(
                    simulated._cubes[moved], T_base_cube=push @ simulated._cubes[moved].T_base_cube
                )
            return grab(count)

        connection.frames.grab = pushed  # type: ignore[method-assign]

    run = run_whole(task2, tmp_path, meddle=meddle)
    assert isinstance(run.error, ExecutionStopped), run.said
    assert "1 of 2 cubes not confirmed" in str(run.error)
    report = run.error.data
    # of its farthest point, which noise moves by some hundredths of a mm
    assert any(re.search(r"board 03-04 moved by 7\.[123] mm", remark) for remark in report["remarks"])
    assert len(report["plans_sha256"]) == 2
    assert [c["placed"] for c in report["cubes"]] == [False, True]
    assert max(c["error_mm"] for c in report["cubes"]) <= 1.0


@pytest.mark.slow
def test_a_cube_taken_from_under_the_jaws_stops_the_run_with_the_arm_at_q_start(
    task2: Path, tmp_path: Path
) -> None:
    def meddle(connection: Connection) -> None:
        simulated = connection.simulated
        assert simulated is not None
        close, count = simulated._close, [0]

        def stolen(T_base_tool: np.ndarray, target: float) -> float:
            count[0] += 1
            if count[0] == 2:  # the second cube is taken away under the closing jaws
                away = board_placement((0.2, 0.6, 0.02), 0.0, 0.0, 0.0)
                gaps = [np.linalg.norm((c.T_base_cube - T_base_tool)[:3, 3]) for c in simulated._cubes]
                between = int(np.argmin(gaps))
                simulated._cubes[between] = replace(
                    simulated._cubes[between], T_base_cube=away, where="table"
                )
            return close(T_base_tool, target)

        simulated._close = stolen  # type: ignore[method-assign]

    run = run_whole(task2, tmp_path, meddle=meddle)
    assert isinstance(run.error, ExecutionStopped)
    cubes = run.error.data["cubes"]
    assert [c["placed"] for c in cubes] == [True, False]
    assert f"the cube of {cubes[1]['from']} was not gripped" in str(run.error)
    assert run.record is not None
    unit = run.task.cell.unit
    assert unit.positions(run.record.counts[-1]) == pytest.approx(run.task.cell.q_start, abs=2e-5)


@pytest.mark.slow
def test_a_cube_lost_on_the_way_and_jaws_that_stay_shut_stop_the_run(task2: Path, tmp_path: Path) -> None:
    def lose(connection: Connection) -> None:
        """The jaws of the unit close further in the middle of the carrying motion."""
        emulator, frames = connection.emulator, connection.mars.note
        assert emulator is not None

        def note(kind: str, **data: object) -> None:
            if kind == "step" and ": to 03-04/" in str(data["name"]):
                emulator.machine.jaws._at -= 100.0
            frames(kind, **data)

        connection.mars.note = note  # type: ignore[method-assign]

    def slip(connection: Connection) -> None:
        """They are found further closed where the cube is to be let go."""
        mars = connection.mars
        read = mars.jaws
        mars.jaws = lambda: min(1.0, read() + 0.3)  # type: ignore[method-assign]

    def jam(connection: Connection) -> None:
        simulated = connection.simulated
        assert simulated is not None
        simulated._open = lambda T, target: 1.0 - simulated.jaw_opening / simulated.cell.gripper.opening  # type: ignore

    for meddle, step, words in (
        (lose, ": to 03-04/", "was lost: the jaws were"),
        (slip, "let go", "was lost: the jaws were"),
        (jam, "", "the jaws do not open to release"),
    ):
        run = run_whole(task2, tmp_path / meddle.__name__, meddle=meddle)
        assert isinstance(run.error, ExecutionStopped), run.said
        assert words in str(run.error)
        assert step in run.error.data.get("step", "")
        assert ("is in the jaws" in str(run.error)) == (meddle is jam)
        report = json.loads((run.folder / "report.json").read_text())
        assert report["error"]["exit_code"] == 4


@pytest.mark.slow
def test_jaws_that_fail_to_hold_a_cube_leave_it_and_go_on(task2: Path, tmp_path: Path) -> None:
    def meddle(connection: Connection) -> None:
        simulated = connection.simulated
        assert simulated is not None
        close, count = simulated._close, [0]

        def slipping(T_base_tool: np.ndarray, target: float) -> float:
            count[0] += 1
            return target if count[0] == 1 else close(T_base_tool, target)

        simulated._close = slipping  # type: ignore[method-assign]

    run = run_whole(task2, tmp_path, meddle=meddle)
    assert isinstance(run.error, ExecutionStopped), run.said  # one cube is not placed
    cubes = run.error.data["cubes"]
    assert [c["placed"] for c in cubes] == [False, True]
    assert {c["from"] for c in cubes} == {"01-02/1", "01-02/3"}
    assert any(
        f"{cubes[0]['from']} is not gripped: the jaws closed on nothing" in remark
        for remark in run.error.data["remarks"]
    )


@pytest.mark.slow
def test_a_cube_taken_away_before_its_turn_is_told_and_left_out(tmp_path: Path) -> None:
    taken_from: list[str] = []

    def meddle(connection: Connection) -> None:
        simulated, grab, looks = connection.simulated, connection.frames.grab, [0]
        assert simulated is not None

        def taken(count: int) -> list[np.ndarray]:
            looks[0] += 1
            if looks[0] == 3:
                gone = next(c for c in reversed(simulated._cubes) if c.name != simulated.events[-1].cube)
                simulated._cubes = [c for c in simulated._cubes if c is not gone]
                taken_from.append(f"01-02/{gone.name.split()[1]}")
            return grab(count)

        connection.frames.grab = taken  # type: ignore[method-assign]

    run = run_whole(quick_scenes(tmp_path, 1, 2, 3) / "task2.toml", tmp_path / "run", meddle=meddle)
    assert run.error is None, run.said
    (hole,) = taken_from
    assert {c["from"] for c in run.report["cubes"]} == {f"01-02/{n}" for n in (1, 2, 3)} - {hole}
    assert any(f"hole {hole} looks empty, not cube" in remark for remark in run.report["remarks"])


@pytest.mark.slow
def test_jaws_that_stop_narrower_or_wider_than_a_cube_have_not_gripped_one(
    task2: Path, tmp_path: Path
) -> None:
    """Told before the arm lifts: the jaws open where they are, the arm backs out, and the others are moved."""

    def stopping(at_mm: float) -> Callable[[Connection], None]:
        def meddle(connection: Connection) -> None:
            simulated = connection.simulated
            assert simulated is not None
            close, count = simulated._close, [0]

            def blocked(T_base_tool: np.ndarray, target: float) -> float:
                count[0] += 1
                if count[0] != 1:
                    return close(T_base_tool, target)
                return simulated.cell.gripper.fraction_closed(at_mm / 1e3)

            simulated._close = blocked  # type: ignore[method-assign]

        return meddle

    for at_mm, words in ((31.0, "by its edge"), (48.0, "something else is between them")):
        run = run_whole(task2, tmp_path / f"{at_mm:g}", meddle=stopping(at_mm))
        assert isinstance(run.error, ExecutionStopped), run.said  # one cube is not placed
        cubes = run.error.data["cubes"]
        assert [c["placed"] for c in cubes] == [False, True]
        assert words in cubes[0]["remarks"][0]
        assert f"the jaws stopped {at_mm:.1f} mm apart, a cube is 40 +- 3.1 mm wide" in run.said
        assert run.simulated is not None
        first = next(e for e in run.simulated.events if e.what == "gripped")
        assert first.cube != f"cube {cubes[0]['from'][-1]}"  # nothing was lifted with it
