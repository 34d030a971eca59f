"""The plan file: the same plan is the same bytes, a round trip loses nothing, a damaged file is told by its key."""

import copy
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from arm.controller.segments import CountPath, Segment
from arm.errors import FileInputError, InputError
from arm.plan_file import ROUNDING, GripperStep, LookStep, Move, Pause, Plan, read_plan, write_plan

ROW = (10, -20, 30, 0, 5, 1)
BOUNDS = (0.05, 0.0123457)  # of both segments; the least is the move's but for rounding


def _plan() -> Plan:
    start = (-181650, -349, -62200, 99200, 8300, -96500)
    first = CountPath(start, (Segment(100, (ROW, ROW, ROW)), Segment(80, (ROW,))))
    second = CountPath(first.end, (Segment(100, (ROW,)),))
    return Plan(
        task={"name": "t"},
        unit="crs93",
        speed=0.5,
        speed_registers=(7680, 2048, 5120, 7680, 7680, 19200),
        acceleration_registers=(51, 10, 20, 38, 128, 768),
        steps=(
            Move(
                "there", "transit", 0, first, None, 0.06, 0.0123456789, ("palm", "table"), clearances=BOUNDS
            ),
            GripperStep("close", "close", 0, 0.4, 1.0),
            Move("back", "retract", 0, second, "cube 1", 0.04, 0.02, ("palm", "wall"), True, (), (0.02,)),
            LookStep("look"),
            LookStep("second look", cube=0),
        ),
        provenance={"seed": 0},
    )


def test_round_trip(tmp_path: Path) -> None:
    path = tmp_path / "plan.json"
    write_plan(path, _plan())
    assert read_plan(path) == _plan()
    assert path.read_text() == _plan().to_json()
    assert read_plan(path).sha256 == _plan().sha256


def test_a_move_that_is_not_certified_may_lack_clearances(tmp_path: Path) -> None:
    path = tmp_path / "plan.json"
    path.write_text(_damaged(lambda v: v["steps"][0].update(clearances=[])))
    assert next(read_plan(path).moves).clearances == ()


def test_figures_of_a_plan() -> None:
    plan = _plan()
    assert plan.duration_s == pytest.approx(0.28)
    assert plan.start == (-181650, -349, -62200, 99200, 8300, -96500)


def test_pauses_and_pairs_that_may_touch_are_kept(tmp_path: Path) -> None:
    plan = _plan()
    first, *others = plan.steps
    assert isinstance(first, Move)
    touching = replace(first, allowed_pairs=(("box", "finger_l"),))
    kept = replace(plan, steps=(touching, Pause("a", 0.5, "box"), Pause("b", 0.0, None, "box"), *others))
    write_plan(tmp_path / "plan.json", kept)
    assert read_plan(tmp_path / "plan.json") == kept
    assert '"pairs"' not in plan.to_json()


def test_an_arm_may_have_any_number_of_axes(tmp_path: Path) -> None:
    """As many as it has registers of speed; every row has to have the same number."""
    path = CountPath((0,) * 7, (Segment(100, ((*ROW, 3),)),))
    move = Move("there", "line", None, path, None, 0.0, 0.02, ("l1", "wall"), True, (), (0.02,))
    plan = replace(_plan(), steps=(move,), speed_registers=(1,) * 7, acceleration_registers=(1,) * 7)
    write_plan(tmp_path / "plan.json", plan)
    assert read_plan(tmp_path / "plan.json") == plan
    write_plan(tmp_path / "plan.json", replace(plan, speed_registers=(1,) * 6))
    with pytest.raises(FileInputError, match=r"acceleration_registers = .* must be 6 whole numbers"):
        read_plan(tmp_path / "plan.json")


def _damaged(change: Any) -> str:
    value = json.loads(_plan().to_json())
    change(value)
    return json.dumps(value)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda v: v.update(format="other"), "format = 'other': must be 'a465-plan/3'"),
        (lambda v: v.update(speed=1.5), "speed = 1.5: must be a number from"),
        (lambda v: v.pop("unit"), "unit: is missing"),
        (
            lambda v: v["task"].update(threaded_before="x"),
            "task.threaded_before = 'x': must be a whole number",
        ),
        (
            lambda v: v["task"].update(threaded_before=-2),
            "task.threaded_before = -2: must be a whole number from 0",
        ),
        (
            lambda v: v["steps"][0]["segments"][0].__setitem__(0, "x"),
            r"steps\[0\]\.segments\[0\] = 'x': duration",
        ),
        (lambda v: v["steps"][0]["segments"][0].__setitem__(0, -1), r"segments\[0\] = -1: duration"),
        (lambda v: v["steps"][0]["segments"][0].__setitem__(0, 60_001), r"segments\[0\] = 60001: duration"),
        (lambda v: v["steps"][0]["segments"][0][1].pop(), r"must be 6 whole numbers"),
        (lambda v: v["steps"][0]["segments"][0].append(list(ROW)), r"segments\[0\] = .*1 to 3 rows of coeff"),
        (
            lambda v: v["steps"][0]["segments"][1].pop(),
            r"segments\[1\] = .*must be a duration in ms and 1 to 3",
        ),
        (
            lambda v: v.update(scene={"allowed": [["palm", 3]]}),
            r"scene\.allowed\[0\] = .*names of two bodies",
        ),
        (lambda v: v["steps"][0]["segments"][0][1].__setitem__(0, 2**31), "32-bit"),
        (lambda v: v["steps"][0]["segments"][0][1].__setitem__(0, True), "whole numbers"),
        (lambda v: v["steps"][2]["start_counts"].__setitem__(0, 7), "'there' ends at"),
        (lambda v: v["steps"][1].update(action="squeeze"), "one of open, close"),
        (lambda v: v["steps"][3].update(step="dance"), "must be move, gripper, look or pause"),
        (lambda v: v.update(steps=[]), "must contain a move"),
        (lambda v: v["steps"][0].update(role="jump"), "one of home, transit, approach, line, retract"),
        (lambda v: v["steps"][0].update(segments=[]), r"steps\[0\]\.segments = \[\]: must be at least one"),
        (lambda v: v["steps"][0].pop("clearances"), r"steps\[0\]\.clearances: is missing"),
        (lambda v: v["steps"][0]["clearances"].pop(), r"steps\[0\]\.clearances = 1: .* segments, 2"),
        (lambda v: v["steps"][2].update(clearances=[]), r"steps\[2\]\.clearances = 0: .* segments, 1"),
        (
            lambda v: v["steps"][2].update(clearances=[0.02, 0.02]),
            r"steps\[2\]\.clearances = 2: .* segments, 1",
        ),
        (lambda v: v["steps"][0]["clearances"].__setitem__(0, "x"), "numbers in m, one for each segment"),
        (
            lambda v: v["steps"][0]["clearances"].__setitem__(1, 0.0123),
            r"clearances = 0\.0123: the smallest must be the move's clearance, 0\.0123457 m",
        ),
        (lambda v: v["steps"][0]["clearances"].__setitem__(1, 0.0124), "the smallest must be the move's"),
        (lambda v: v["steps"][0].update(clearance=0.0124), "the smallest must be the move's"),
    ],
)
def test_damage_is_reported_by_key(tmp_path: Path, change: Any, message: str) -> None:
    path = tmp_path / "plan.json"
    path.write_text(_damaged(change))
    with pytest.raises(FileInputError, match=message) as error:
        read_plan(path)
    assert "plan again" in str(error.value)


@pytest.mark.parametrize("duration_ms", [0, 60_000])
def test_segments_last_from_nothing_to_a_minute(tmp_path: Path, duration_ms: int) -> None:
    path = tmp_path / "plan.json"
    path.write_text(_damaged(lambda v: v["steps"][0]["segments"][0].__setitem__(0, duration_ms)))
    assert next(read_plan(path).moves).path.segments[0].duration_ms == duration_ms


@pytest.mark.parametrize("text", ["", "{", "[]", "null", "\x00"])
def test_a_file_that_is_not_a_plan_is_refused(tmp_path: Path, text: str) -> None:
    path = tmp_path / "plan.json"
    path.write_text(text)
    with pytest.raises(FileInputError):
        read_plan(path)


def test_a_missing_file_and_a_folder_are_refused(tmp_path: Path) -> None:
    for path in (tmp_path / "none.json", tmp_path):
        with pytest.raises(InputError, match=r"cannot be read|is a folder"):
            read_plan(path)


def test_plans_are_values() -> None:
    assert copy.deepcopy(_plan()) == _plan()


def test_the_least_of_the_segments_is_the_moves_but_for_rounding(tmp_path: Path) -> None:
    def read(clearance: float, least: float) -> Plan:
        def change(value: dict[str, Any]) -> None:
            value["steps"][0].update(clearance=clearance, clearances=[1e9, least])

        (tmp_path / "plan.json").write_text(_damaged(change))
        return read_plan(tmp_path / "plan.json")

    for clearance, least in ((0.0, 0.0), (0.0, ROUNDING), (0.02, 0.02)):
        assert next(read(clearance, least).moves).clearance == clearance
    for clearance, least in ((0.0, 1.01 * ROUNDING), (0.02, 0.02 - 1e-12)):
        with pytest.raises(FileInputError, match=r"steps\[0\]\.clearances"):
            read(clearance, least)


def test_what_a_move_may_touch_is_a_list_of_names(tmp_path: Path) -> None:
    path = tmp_path / "plan.json"
    path.write_text(_damaged(lambda v: v["steps"][2].update(touching=["plate 01-02", "table"])))
    assert [move.allowed_collisions for move in read_plan(path).moves][1] == ("plate 01-02", "table")
    for wrong in ([1], ["table", None]):
        path.write_text(_damaged(lambda v, wrong=wrong: v["steps"][2].update(touching=wrong)))  # type: ignore[misc]
        with pytest.raises(FileInputError, match=r"touching.*must be body names"):
            read_plan(path)
