"""What binds a saved plan to the present cell: its provenance to the last digit, and where the boards stand."""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from arm.controller.segments import CountPath
from arm.controller.unit_keys import REST_TOLERANCE
from arm.errors import A465Error, ImpossibleError
from arm.plan_file import Plan, read_plan
from arm.robot.shapes import Body, Box, body_from_json
from arm.se3 import rotation, transform
from cell.files.task import Task, read_task
from cell.task.plan_matches import (
    SAME,
    _differing,
    check_plan,
    replayed,
    require_match,
    require_scene,
    require_start_at,
)
from cell.task.planning import Rest, plan_rest
from plan.collision.certificate import ClearanceCertificate
from plan.scene import scene_from_json
from plan.verify import ReplayedMove
from tasks.seen_cells import with_pose
from typed.command_line import replace_in
from vision.observation import Observation
from vision.occupancy.classify import HoleState, Occupancy

pytestmark = pytest.mark.xdist_group("checking")


@pytest.fixture(scope="module")
def scenes(planned_scenes: Path) -> Path:
    return planned_scenes


def _changed_digits(text: str) -> Iterator[dict[str, Any]]:
    """The JSON value with each of its digits (hexadecimal ones too, in hashes) changed, where that is still JSON."""
    digits, inside = "0123456789abcdef", False  # a quoted text: only there, letters are digits
    for i, c in enumerate(text):
        inside ^= c == '"'
        if c not in digits or (c.isalpha() and not inside):
            continue
        try:
            other = digits[(digits.index(c) + 1) % (16 if c.isalpha() else 10)]
            value = json.loads(text[:i] + other + text[i + 1 :])
        except ValueError:
            continue
        yield value


@pytest.mark.slow
def test_every_digit_of_the_provenance_binds(task: Task, plan: Plan, monkeypatch: pytest.MonkeyPatch) -> None:
    """One after another is changed, of values and of keys: none of these plans is for the present cell."""
    require_match(task, plan)
    robots = {opening: task.cell.robot(opening) for opening in (None, task.cell.cube_size)}
    monkeypatch.setattr(type(task.cell), "robot", lambda _, opening=None: robots[opening])
    tried = 0
    for provenance in _changed_digits(json.dumps(plan.provenance)):
        if provenance == plan.provenance:  # such as 0.5 and 0.50
            continue
        tried += 1
        with pytest.raises(ImpossibleError, match="not for the present cell") as refusal:
            require_match(task, replace(plan, provenance=provenance))
        assert refusal.value.data["differing"]
    assert tried > 900


def test_a_provenance_that_lacks_or_adds_a_key_is_refused(task: Task, plan: Plan) -> None:
    for key in plan.provenance:
        less = {k: v for k, v in plan.provenance.items() if k != key}
        with pytest.raises(ImpossibleError, match="not for the present cell") as refusal:
            require_match(task, replace(plan, provenance=less))
        assert key in refusal.value.data["differing"]
    with pytest.raises(ImpossibleError, match="extra 1, now not given"):
        require_match(task, replace(plan, provenance={**plan.provenance, "extra": 1}))


@pytest.mark.parametrize(
    ("what", "of_plan", "told"),
    [
        ("unit", {"unit": "crs97"}, "is for unit crs97, but task2.toml is of unit crs93"),
        (
            "task",
            {"task": {"name": "sort"}},
            r"is for task sort \(board-to-board\), but task2.toml is of task task2 \(board-to-board\)",
        ),
    ],
)
def test_a_plan_for_another_unit_or_task_is_told_by_that_alone(
    task: Task, plan: Plan, what: str, of_plan: dict[str, Any], told: str
) -> None:
    other = replace(plan, **{k: {**plan.task, **v} if k == "task" else v for k, v in of_plan.items()})
    with pytest.raises(ImpossibleError, match=told) as refusal:
        require_match(task, other)
    assert refusal.value.data["differing"] == [what]


def test_notes_bind_nothing_but_change_the_code(task: Task, plan: Plan) -> None:
    assert {"a465", "versions"} <= set(plan.notes)
    other = replace(plan, notes={**plan.notes, "a465": "another"})
    require_match(task, other)
    assert other.code != plan.code
    assert other.sha256 != plan.sha256


@pytest.mark.parametrize(
    ("old", "new"), [("moved_mm = 1.5", "moved_mm = 1.4"), ("moved_deg = 1.0", "moved_deg = 2")]
)
def test_what_a_board_may_move_is_part_of_what_a_plan_is_bound_to(
    scenes: Path, tmp_path: Path, old: str, new: str
) -> None:
    copy = Path(shutil.copytree(scenes, tmp_path / "scenes"))
    replace_in(copy / "cell.toml", old, new)
    told = rf"cell.toml: look.{old.split()[0]} {float(old.split()[2]):g}, now {float(new.split()[2]):g}"
    with pytest.raises(ImpossibleError, match=told):
        require_match(read_task(copy / "task2.toml"), read_plan(copy / "plan.json"))


def test_a_saved_plan_is_refused_where_a_board_moved_or_turned(
    task: Task, plan: Plan, seen: Observation
) -> None:
    cell, name = task.cell, "03-04"
    T = next(b for b in seen.boards if b.name == name).pose.T_base_board
    require_scene(task, plan, seen)
    for shift in (0.9, 1.1):
        moved = with_pose(seen, name, transform(t=(shift * cell.moved, 0.0, 0.0)) @ T)
        if shift < 1.0:
            require_scene(task, plan, moved)
            continue
        with pytest.raises(ImpossibleError, match=r"plate 03-04 is 1\.[67] mm and 0.00 deg from its planned"):
            require_scene(task, plan, moved)
    centre = T @ transform(t=(0.09, 0.07, 0.0))
    for turn in (0.9, 1.1):  # about its centre, in the plane
        turned = with_pose(
            seen,
            name,
            centre @ transform(rotation((0.0, 0.0, turn * cell.turned))) @ transform(t=(-0.09, -0.07, 0.0)),
        )
        loose = replace(task, cell=replace(cell, moved=0.1))
        if turn < 1.0:
            require_scene(loose, plan, turned)
            continue
        with pytest.raises(ImpossibleError, match=r"plate 03-04 is .* mm and 1\.10 deg from its planned"):
            require_scene(loose, plan, turned)


def test_a_small_turn_that_moves_a_corner_too_far_counts_as_moved(
    task: Task, plan: Plan, seen: Observation
) -> None:
    """Its centre stays: the board's corners are what the certificate is about."""
    name = "03-04"
    T = next(b for b in seen.boards if b.name == name).pose.T_base_board
    about = T @ transform(t=(0.09, 0.07, 0.0)) @ transform(rotation((0.0, 0.0, np.radians(0.8))))
    with pytest.raises(ImpossibleError, match=r"plate 03-04 is 2\.[0-9] mm and 0.80 deg"):
        require_scene(task, plan, with_pose(seen, name, about @ transform(t=(-0.09, -0.07, 0.0))))


def test_a_saved_plan_is_refused_where_one_of_its_boards_is_not_seen(
    task: Task, plan: Plan, seen: Observation
) -> None:
    for gone in seen.boards:
        rest = replace(seen, boards=tuple(b for b in seen.boards if b.name != gone.name))
        with pytest.raises(ImpossibleError, match=f"plate {gone.name} of the plan was not seen"):
            require_scene(task, plan, rest)


def test_a_board_that_the_plan_does_not_know_refuses_it(task: Task, plan: Plan, seen: Observation) -> None:
    other = next(b for b in task.cell.boards if b.name == "05-06")
    extra = replace(
        seen.boards[0], pose=replace(seen.boards[0].pose, board=other), occupancy=(Occupancy("empty"),) * 4
    )
    with pytest.raises(ImpossibleError, match="plate 05-06 is not in the plan"):
        require_scene(task, plan, replace(seen, boards=(*seen.boards, extra)))


def test_a_plan_whose_paddings_were_taken_away_is_refused(task: Task, plan: Plan) -> None:
    """By its scene's hash, and where somebody mends that too, by the scene of the present cell."""
    bare = json.loads(json.dumps(plan.scene))
    for body in (*bare["bodies"], *bare["cubes"]):
        body.pop("padding", None)
        assert body_from_json(body).padding == 0.0
    with pytest.raises(ImpossibleError, match="not for the present cell: scene"):
        replayed(task, replace(plan, scene=bare))
    from arm.io.storage import sha256

    mended = replace(plan, scene=bare, provenance={**plan.provenance, "scene": sha256(bare)})
    with pytest.raises(ImpossibleError, match=r"scene is not that of the present cell: .*plate 01-02"):
        replayed(task, mended)


def test_the_refusal_of_a_line_says_less_clearance_where_boards_may_move_more(
    task: Task, seen: Observation
) -> None:
    wide = replace(task, cell=replace(task.cell, moved=0.0045))
    with pytest.raises(A465Error, match=r"required: 5 mm"):
        plan_rest(Rest(wide, seen, wide.cell.q_start, 0.5))


@pytest.mark.parametrize(("planned", "found"), [("cube", "empty"), ("empty", "cube")])
def test_a_hole_that_looks_otherwise_than_planned_refuses_it_and_an_unsure_one_does_not(
    task: Task, plan: Plan, seen: Observation, planned: HoleState, found: HoleState
) -> None:
    def looks(state: HoleState) -> Observation:
        """As it was seen, but for the first hole that was seen as planned."""
        hole = next(h.name for p in seen.poses for h in p.holes if seen.state(h.name) == planned)
        return seen.with_states({hole: state})

    require_scene(task, plan, looks(planned))
    require_scene(task, plan, looks("unsure"))
    with pytest.raises(ImpossibleError, match=rf"looks {found}, planned was {planned}"):
        require_scene(task, plan, looks(found))


@pytest.mark.parametrize("joint", range(6))
def test_a_plan_that_starts_elsewhere_is_refused_by_axis_and_counts(
    task: Task, plan: Plan, joint: int
) -> None:
    def beginning(offset: int) -> Plan:
        first = next(plan.moves)
        start = tuple(c + offset * (k == joint) for k, c in enumerate(first.path.start))
        steps = [replace(s, path=CountPath(start, s.path.segments)) if s is first else s for s in plan.steps]
        return replace(plan, steps=tuple(steps))

    axis = task.cell.unit.axes[joint]
    for offset in (REST_TOLERANCE, -REST_TOLERANCE):
        require_start_at(task, beginning(offset))
    for offset in (REST_TOLERANCE + 1, -REST_TOLERANCE - 1):
        with pytest.raises(ImpossibleError, match=re.escape(f"off by {axis} {offset:+d} counts")):
            require_start_at(task, beginning(offset))


def test_bodies_written_twice_are_the_same_up_to_rounding_and_no_further(plan: Plan, task: Task) -> None:
    """In place, padding and shape; names that one scene alone has differ."""
    scene = scene_from_json(plan.scene, task.cell.robot(), task.cell.robot_holding())
    scene = replace(scene, bodies=(Body("box", Box((0.1, 0.1, 0.1)), transform(), "plate"), *scene.bodies))
    box = scene.bodies[0]
    assert _differing(scene, scene) == []
    assert _differing(scene, replace(scene, bodies=scene.bodies[1:])) == ["box"]
    for by, differing in ((SAME, []), (1.1 * SAME, ["box"])):
        for other in (
            *(
                box.at(transform(t=tuple(sign * by * (k == i) for k in range(3))))
                for i in range(3)
                for sign in (1, -1)
            ),
            replace(box, padding=box.padding + by),
            replace(box, shape=Box((0.1, 0.1 + 0.99 * by, 0.1))),
        ):
            assert _differing(scene, replace(scene, bodies=(other, *scene.bodies[1:]))) == differing


def _brought(plan: Plan, index: int, **entry: str) -> Plan:
    cubes = [dict(cube) for cube in plan.task["cubes"]]
    cubes[index].update(entry)
    return replace(plan, task={**plan.task, "cubes": cubes})


@pytest.mark.slow
def test_a_plan_that_says_it_brings_a_cube_where_its_motion_does_not_is_refused(
    task: Task, plan: Plan
) -> None:
    """An edited `to` would send the look after the cube to another hole."""
    places = [cube["to"] for cube in plan.task["cubes"]]
    board = places[0].rpartition("/")[0]
    for index, place in enumerate(places):
        for other in (p for p in places if p != place):
            with pytest.raises(ImpossibleError, match=f"brings .* to '{other}', but its motion") as refused:
                replayed(task, _brought(plan, index, to=other))
            assert refused.value.data["off_m"] > 0.03
    for nowhere in (f"{board}/9", f"{board}/x", board, "", "table/0", "table/x"):
        with pytest.raises(ImpossibleError, match="which is no place"):
            replayed(task, _brought(plan, 0, to=nowhere))
    with pytest.raises(ImpossibleError, match="where there is another cube"):
        replayed(task, _brought(plan, 0, **{"from": plan.task["cubes"][1]["from"]}))


def test_what_a_check_prints_of_the_whole_plan_is_of_its_worst_move(
    task: Task, plan: Plan, monkeypatch: pytest.MonkeyPatch
) -> None:
    move = next(plan.moves)
    moves = tuple(
        ReplayedMove(
            move, ClearanceCertificate(clearance, clearance, ("a", "b"), 0.0, True, 1), velocity, acceleration
        )
        for clearance, velocity, acceleration in ((0.02, 0.3, 0.8), (0.007, 0.9, 0.1), (0.03, 0.1, 0.2))
    )
    monkeypatch.setattr("cell.task.plan_matches.replayed", lambda *_: moves)
    told = check_plan(task, plan)
    assert (told["min_clearance_mm"], told["peak_velocity"], told["peak_acceleration"]) == (7.0, 0.9, 0.8)
    assert [row["proved_mm"] for row in told["moves"]] == [20.0, 7.0, 30.0]
    assert {row["stated_mm"] for row in told["moves"]} == {1e3 * move.clearance}
