"""What a run knows of cubes that are not where they should be, and how often it tries."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from arm.errors import ImpossibleError
from arm.io.storage import data_file
from arm.numerics.products import mul
from arm.se3 import frozen, rot_z, transform
from cell.cubes.confirm_placed import Release
from cell.cubes.recovery import Recovery
from cell.files.task import read_task
from cell.report.cubes import UNDECIDED, CubeRow
from cell.scene.build import hole_station
from cell.scene.displaced import DisplacedCube
from cell.sim.release_faults import T_hole_released
from tasks.true_look import true_look
from vision.observation import Observation
from vision.occupancy.classify import OTHER, Occupancy
from vision.occupancy.seated import CubeWidth

TASK = read_task(data_file("scenes/task2.toml"))
SEEN = true_look(TASK)
CUBE, HOME, TARGET = "cube 01-02/4", "01-02/4", "03-04/1"


@pytest.fixture
def found(monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    """What the next looks find: the place of a cube, or why none; and whether a cube in a hole is seated."""
    now: dict[str, Any] = {"cube": "nothing shows", "seat": "off", "asked": []}

    def locate(task: Any, look: Any, name: str, places: list[str], *_: Any) -> Any:
        now["asked"].append(tuple(places))
        return now["cube"]

    monkeypatch.setattr("cell.cubes.recovery.locate_displaced", locate)
    monkeypatch.setattr("cell.cubes.recovery.seated", lambda *_: SimpleNamespace(state=now["seat"]))
    return now


def _beside(place: str, fault: str = "aside") -> DisplacedCube:
    board, number = place.split("/")
    seen = SEEN.board(board)
    if seen is None:
        raise ValueError(place)
    T = mul(seen.pose.holes[int(number) - 1].T_base_hole, T_hole_released(fault, TASK.cell.cube_size))
    return DisplacedCube(CUBE, place, frozen(T))


def _release(source: str = HOME, target: str = TARGET) -> Release:
    T_base_tool = hole_station(TASK.cell, SEEN.boards[1].pose.holes[0]).T_base_tool[0]
    return Release(CubeRow(HOME, TARGET), source, target, SEEN, T_base_tool, CubeWidth(0.04, 1e-4))


def _unsure(place: str, look: Observation = SEEN) -> Observation:
    boards = []
    for board in look.boards:
        states = [
            Occupancy("unsure", 0.5, OTHER) if hole.name == place else now
            for hole, now in zip(board.pose.holes, board.occupancy, strict=True)
        ]
        boards.append(replace(board, occupancy=tuple(states)))
    return replace(look, boards=tuple(boards))


def test_without_attempts_nothing_is_taken_again(found: dict[str, Any]) -> None:
    recovery = Recovery(TASK, 0)
    found["cube"] = _beside(HOME)
    assert recovery.after_miss(SEEN, CUBE, HOME) is None
    assert recovery.after_release(SEEN, CUBE, _release()) is None
    assert recovery.survey(_unsure(HOME)) == []
    assert not recovery.cubes
    assert found["asked"] == []


@pytest.mark.parametrize("most", [1, 3])
def test_a_seated_cube_is_taken_again_only_so_often(found: dict[str, Any], most: int) -> None:
    recovery = Recovery(TASK, most)
    found["seat"] = "seated"
    for n in range(1, most + 1):
        assert f"({n} of {most})" in str(recovery.after_miss(SEEN, CUBE, HOME))
        assert recovery.goes_on(CUBE)
    assert f"it was taken again {most} time" in str(recovery.after_miss(SEEN, CUBE, HOME))
    assert not recovery.goes_on(CUBE)
    assert not recovery.displaced
    assert found["asked"] == []  # what the look shows seated is not searched for


@pytest.mark.parametrize("seat", ["off", "unsure"])
def test_a_cube_that_is_not_certainly_seated_is_located(found: dict[str, Any], seat: str) -> None:
    """Jaws that close on a leaning cube as on a seated one push it again."""
    recovery = Recovery(TASK, 3)
    found |= {"cube": _beside(HOME, "half"), "seat": seat}
    assert "tilted by 8.0 deg; it is taken again (1 of 3)" in str(recovery.after_miss(SEEN, CUBE, HOME))
    assert recovery.displaced == {CUBE: found["cube"]}
    assert recovery.where(CUBE, HOME) == f"beside {HOME}"


@pytest.mark.parametrize(("seat", "again"), [("unsure", True), ("off", False)])
def test_a_hole_that_shows_a_cube_is_believed_unless_it_certainly_does_not_sit(
    found: dict[str, Any], seat: str, again: bool
) -> None:
    recovery = Recovery(TASK, 3)
    found["seat"] = seat
    assert (recovery.after_miss(SEEN, CUBE, HOME) is not None) is again
    assert found["asked"] == [(HOME,)]


@pytest.mark.parametrize(("seat", "words"), [("seated", f"{CUBE} is seated in {TARGET}"), ("unsure", None)])
def test_a_cube_that_the_jaws_seated_where_it_was_released_is_not_in_its_hole(
    found: dict[str, Any], seat: str, words: str | None
) -> None:
    recovery = Recovery(TASK, 3)
    found["seat"] = seat
    look = SEEN.with_states({HOME: "empty", TARGET: "cube"})
    assert recovery.after_miss(look, CUBE, f"beside {TARGET}") == words
    assert recovery.where(CUBE, f"beside {TARGET}") == TARGET


def test_a_cube_that_stays_is_located_in_each_new_look_once(found: dict[str, Any]) -> None:
    """Its board may have moved with it."""
    recovery, first = Recovery(TASK, 3), _beside(HOME)
    recovery.stuck, found["cube"] = {CUBE: first}, _beside(HOME, "half")
    for look in (SEEN, SEEN):
        assert recovery.locate_again(look) == []
    assert recovery.stuck == {CUBE: found["cube"]}
    assert found["asked"] == [(HOME,)]


def test_a_cube_that_is_not_located_counts_and_is_not_taken_again(found: dict[str, Any]) -> None:
    recovery = Recovery(TASK, 3)
    assert recovery.after_miss(SEEN, CUBE, HOME) is None
    assert recovery.after_release(SEEN, CUBE, _release()) is None
    assert recovery.not_located == {CUBE: "nothing shows"}
    assert recovery.tried[CUBE] == 2
    assert found["asked"] == [(HOME,), (TARGET, HOME)]


def test_a_cube_that_did_not_seat_is_corrected_at_the_same_place_and_at_last_put_back(
    found: dict[str, Any],
) -> None:
    recovery = Recovery(TASK, 2)
    found["cube"] = _beside(TARGET, "half")
    free = cast(Any, lambda: pytest.fail("its target is known"))
    look = SEEN.with_states({HOME: "empty"})
    for _ in range(2):
        assert recovery.after_release(look, CUBE, _release()) is not None
        (goal,) = recovery.goals(found["cube"], look, free)
        assert goal.name == TARGET
        assert len(goal.T_base_tool) == 2
    assert recovery.after_release(look, CUBE, _release()) is not None
    (goal,) = recovery.goals(found["cube"], look, free)
    assert goal.name == HOME
    with pytest.raises(ImpossibleError, match="its hole 01-02/4 is not free"):
        recovery.goals(found["cube"], SEEN, free)
    recovery.after_release(look, CUBE, _release(f"beside {TARGET}", HOME))
    with pytest.raises(ImpossibleError, match="taken again 2 times, and putting it back failed"):
        recovery.goals(found["cube"], look, free)


def test_a_cube_that_was_never_released_goes_to_any_free_place(found: dict[str, Any]) -> None:
    recovery = Recovery(TASK, 2)
    found["cube"] = _beside(HOME)
    recovery.after_miss(SEEN, CUBE, HOME)
    stations = (hole_station(TASK.cell, SEEN.boards[1].pose.holes[2]),)
    assert recovery.goals(found["cube"], SEEN, lambda: stations) is stations
    with pytest.raises(ImpossibleError, match="no place is free and in reach"):
        recovery.goals(found["cube"], SEEN, lambda: ())
    assert recovery.target(found["cube"]) == UNDECIDED
    recovery.leave(found["cube"])
    assert not recovery.displaced
    assert recovery.cubes == (found["cube"],)


def test_a_cube_that_no_plan_moves_waits_once_for_the_others(found: dict[str, Any]) -> None:
    recovery = Recovery(TASK, 3)
    found["cube"] = cube = _beside(HOME)
    recovery.after_miss(SEEN, CUBE, HOME)
    assert not recovery.take_up()
    assert recovery.wait(cube)
    assert (recovery.displaced, recovery.stuck) == ({}, {CUBE: cube})
    assert recovery.take_up()
    assert (recovery.displaced, recovery.stuck) == ({CUBE: cube}, {})
    assert not recovery.wait(cube)
    assert not recovery.take_up()
    assert recovery.stuck == {CUBE: cube}


def test_a_cube_that_is_taken_again_no_more_does_not_wait(found: dict[str, Any]) -> None:
    recovery = Recovery(TASK, 1)
    found["cube"] = cube = _beside(HOME)
    for _ in range(2):
        recovery.after_miss(SEEN, CUBE, HOME)
    assert not recovery.wait(cube)
    assert not recovery.take_up()


def test_a_survey_locates_each_cube_once_and_only_at_doubtful_holes_of_the_source(
    found: dict[str, Any],
) -> None:
    recovery = Recovery(TASK, 3)
    found["cube"] = _beside(HOME)
    look = _unsure("03-04/2", _unsure("01-02/2", _unsure(HOME)))
    lines = recovery.survey(look)
    assert len(lines) == 1  # at the other hole the same cube is found
    assert "is taken from there" in lines[0]
    assert found["asked"] == [("01-02/2",), (HOME,)]
    assert len(recovery.displaced) == 1


def test_cubes_of_an_earlier_look_are_located_again_and_left_alone_if_that_fails(
    found: dict[str, Any],
) -> None:
    recovery = Recovery(TASK, 3)
    found["cube"] = first = _beside(HOME)
    recovery.after_miss(SEEN, CUBE, HOME)
    assert recovery.locate_again(SEEN) == []  # it was located in this one
    assert recovery.displaced == {CUBE: first}
    found["cube"] = moved = _beside(HOME, "half")
    later = replace(SEEN)
    assert recovery.locate_again(later) == []
    assert recovery.displaced == {CUBE: moved}
    found["cube"] = "nothing shows"
    (line,) = recovery.locate_again(replace(SEEN))
    assert line == f"{CUBE} stays beside {HOME}, where it was located before; in this look not: nothing shows"
    assert recovery.stuck[CUBE].T_base_cube == pytest.approx(moved.T_base_cube)
    assert not recovery.displaced
    assert recovery.locate_again(replace(SEEN)) == []


@pytest.mark.parametrize("kind", ["displaced", "stuck"])
def test_a_cube_that_a_look_does_not_locate_has_moved_with_its_board(
    found: dict[str, Any], kind: str
) -> None:
    recovery = Recovery(TASK, 3)
    getattr(recovery, kind)[CUBE] = cube = _beside(TARGET)
    found["cube"] = cube
    recovery.locate_again(SEEN)
    found["cube"] = "nothing shows"
    push = transform(rot_z(0.05), (0.012, -0.007, 0.0))
    boards = [
        replace(b, pose=replace(b.pose, T_base_board=frozen(push @ b.pose.T_base_board))) for b in SEEN.boards
    ]
    recovery.locate_again(replace(SEEN, boards=tuple(boards)))
    assert recovery.stuck[CUBE].T_base_cube == pytest.approx(push @ cube.T_base_cube)
    assert recovery.stuck[CUBE].near == TARGET
    recovery.locate_again(Observation())  # nobody sees its board
    assert recovery.stuck[CUBE].T_base_cube == pytest.approx(push @ cube.T_base_cube)


def test_what_a_stopped_run_knew_is_assumed_until_a_look_shows_it(found: dict[str, Any]) -> None:
    recovery, cube = Recovery(TASK, 0), _beside(TARGET)
    recovery.assume([], SEEN)
    assert recovery.most == 0
    recovery.assume([cube], SEEN)
    assert (recovery.stuck, recovery.most) == ({CUBE: cube}, TASK.cell.recovery_attempts)
    assert recovery.find(CUBE, TARGET, SEEN) == "nothing shows"
    assert recovery.stuck == {CUBE: cube}
    found["cube"] = now = _beside(TARGET, "half")
    assert recovery.find(CUBE, TARGET, SEEN) is None
    assert (recovery.stuck, recovery.displaced) == ({}, {CUBE: now})
    (goal,) = recovery.goals(now, SEEN, cast(Any, lambda: pytest.fail("its target is known")))
    assert goal.name == TARGET
    assert recovery.locate_again(SEEN) == []
    assert found["asked"] == [(TARGET,)] * 2


def test_only_looks_that_show_a_place_certainly_empty_are_kept_for_it() -> None:
    recovery = Recovery(TASK, 3)
    recovery.keep_empty(SEEN)
    later = replace(_unsure("03-04/2"), moved_since=frozenset({"03-04/3"}))
    recovery.keep_empty(later)
    assert recovery.empty_look("03-04/1") is later
    assert recovery.empty_look("03-04/2") is SEEN
    assert recovery.empty_look("03-04/3") is SEEN
    assert recovery.empty_look("01-02/1") is None


def test_a_look_at_a_cube_beside_an_empty_hole_does_not_show_that_place_without_it() -> None:
    """Compared with itself, it would show that there is no cube."""
    recovery = Recovery(TASK, 3)
    recovery.keep_empty(SEEN)
    recovery.displaced = {CUBE: _beside(TARGET)}
    later = replace(SEEN)
    recovery.keep_empty(later)
    assert recovery.empty_look(TARGET) is SEEN
    assert recovery.empty_look("03-04/4") is later


def test_a_width_is_measured_before_the_jaws_disturb_a_cube_and_never_after(
    found: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    widths = iter([CubeWidth(0.0401, 1e-5), CubeWidth(0.0412, 1e-5)])
    monkeypatch.setattr("cell.cubes.recovery.width_at", lambda *_: next(widths))
    recovery = Recovery(TASK, 3)
    recovery.keep_width(
        replace(SEEN, moved_since=frozenset({HOME})), CUBE, HOME
    )  # it shows another cube there
    assert recovery.widths == {}
    recovery.keep_width(SEEN, CUBE, HOME)
    recovery.after_miss(SEEN, CUBE, HOME)
    recovery.keep_width(SEEN, CUBE, HOME)
    assert recovery.widths == {CUBE: CubeWidth(0.0401, 1e-5)}
    undisturbed = Recovery(TASK, 3)
    undisturbed.tried[CUBE] = 1
    undisturbed.keep_width(SEEN, CUBE, HOME)
    assert undisturbed.widths == {}


def test_a_measured_width_is_kept_for_the_next_attempt(found: dict[str, Any]) -> None:
    recovery = Recovery(TASK, 3)
    recovery.after_release(SEEN, CUBE, _release())
    recovery.after_release(SEEN, CUBE, replace(_release(), width=None))
    assert recovery.widths == {CUBE: CubeWidth(0.04, 1e-4)}
    assert np.isfinite(recovery.widths[CUBE].value)
