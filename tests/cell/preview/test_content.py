"""What the page is given: one clock, cubes that move with the jaws, the arm's kinematics; no way out of the file."""

import json
import re
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

import arm.board
from arm.board import plate_name
from arm.controller.segments import CountPath
from arm.controller.unit import load_unit
from arm.errors import InputError
from arm.plan_file import GripperStep, Move
from arm.robot.shapes import Capsule, body_from_json, convex
from arm.robot.tool import padded
from arm.se3 import inverse, rot_x, rot_z, rotation, transform
from cell.preview.clearance import sample_clearance
from cell.preview.content import page_content
from cell.preview.overlays import ExecutedMove, marker_rows, shape_numbers
from cell.preview.page import page, write_preview
from cell.preview.timeline import LOOK_S, cube_tracks, timed_steps
from plan.pick_place.planner import plan_task
from plan.scene import Scene, Station, Transfer


def _write(case, path: Path, **options) -> str:
    boards = [place.board for place in case.boards]
    write_preview(
        case.plan, case.robot_open, case.robot_holding, case.unit, path, **{"boards": boards} | options
    )
    return path.read_text()


def _matrix(numbers: list[float]) -> np.ndarray:
    return np.vstack([np.reshape(numbers, (3, 4)), [0.0, 0.0, 0.0, 1.0]])


def test_one_clock_without_gaps(preview_case) -> None:
    steps = timed_steps(preview_case.plan)
    assert steps[0].start_s == 0.0
    for before, after in pairwise(steps):
        assert before.end_s == after.start_s
        assert before.jaws[1] == after.jaws[0]
    waits = sum(s.settle_s for s in preview_case.plan.steps if isinstance(s, GripperStep))
    assert steps[-1].end_s == pytest.approx(preview_case.plan.duration_s + waits + 4 * LOOK_S)


def test_moves_of_one_motion_follow_without_a_pause_and_bring_their_own_bounds(preview_case) -> None:
    """A move cut in two in the middle of its way: the same motion, the same clock, what is held stays held."""
    case = preview_case
    index = next(i for i, s in enumerate(case.plan.steps) if isinstance(s, Move) and s.held)
    move = case.plan.steps[index]
    at = len(move.path.segments) // 2
    middle = tuple(int(c) for c in move.path.knots()[at])
    halves = (
        replace(move, path=CountPath(move.path.start, move.path.segments[:at])),
        replace(move, path=CountPath(middle, move.path.segments[at:])),
    )
    bounds = tuple(move.clearance + 1e-3 * k for k in range(len(halves[1].path.segments)))
    halves = (halves[0], replace(halves[1], clearances=bounds))
    plan = replace(case.plan, steps=(*case.plan.steps[:index], *halves, *case.plan.steps[index + 1 :]))
    content, before = (
        page_content(p, case.robot_open, case.robot_holding, case.unit) for p in (plan, case.plan)
    )
    assert content["motions"] == before["motions"] == len(plan.motions)
    assert content["duration_s"] == pytest.approx(before["duration_s"])
    assert [c["track"] for c in content["cubes"]] == [c["track"] for c in before["cubes"]]
    first, second = content["steps"][index : index + 2]
    assert first["end"] == second["start"]
    assert (first["joined"], second["joined"]) == (before["steps"][index]["joined"], True)
    assert first["clearances"] == []
    assert second["clearances"] == pytest.approx(bounds, abs=1e-6)
    assert max(s - b for s, b in zip(second["clearances"], bounds, strict=True)) <= 0.0
    last = halves[0].path.segments[-1].derivative(1.0)
    assert np.abs(last).max() > 1000.0  # counts/s: they meet at speed
    assert last == pytest.approx(halves[1].path.segments[0].derivative(0.0), abs=20.0)
    sampled = sample_clearance(plan, case.robot_open, case.robot_holding, case.unit, every_s=0.5)
    assert sampled[index][-1].distance == pytest.approx(sampled[index + 1][0].distance, abs=1e-6)


def test_jaws_are_closed_exactly_while_a_cube_is_held(preview_case) -> None:
    for timed in timed_steps(preview_case.plan):
        if isinstance(timed.step, Move):
            assert timed.jaws == ((1.0, 1.0) if timed.step.held else (0.0, 0.0))


def test_cubes_do_not_jump_and_end_in_their_holes(preview_case) -> None:
    case = preview_case
    steps = timed_steps(case.plan)
    cubes = [body_from_json(c) for c in case.plan.scene["cubes"]]
    tracks = cube_tracks(steps, cubes, case.robot_open, case.unit)
    starts = {t.start_s: t.step for t in steps if isinstance(t.step, Move)}
    for hole, (name, track) in enumerate(tracks.items()):
        assert [pose.held for pose in track] == [False, True, False], name
        for before, after in pairwise(track):
            T_base_tool = case.robot_open.T_base_tool(case.unit.positions(starts[after.start_s].path.start))
            poses = [T_base_tool @ p.T if p.held else p.T for p in (before, after)]
            assert np.abs(poses[0] - poses[1]).max() < 1e-9
        target = case.boards[1]
        T_hole_cube = inverse(target.T_base_board @ target.board.T_board_hole(hole)) @ track[-1].T
        assert np.abs(T_hole_cube[:2, 3]).max() < 1e-4  # the made-up plan rounds to counts
        assert T_hole_cube[2, 3] == pytest.approx(0.012, abs=1e-4)


def test_a_cube_that_is_not_in_the_scene_is_told(preview_case) -> None:
    plan = replace(preview_case.plan, scene=preview_case.plan.scene | {"cubes": []})
    with pytest.raises(
        InputError, match=r"cube 1: retract: holds 'cube 1', must be a cube of the plan's scene"
    ):
        page_content(plan, preview_case.robot_open, preview_case.robot_holding, preview_case.unit)


def test_the_chain_is_the_robot(preview_case) -> None:
    content = page_content(
        preview_case.plan, preview_case.robot_open, preview_case.robot_holding, preview_case.unit
    )
    rng = np.random.default_rng(5)
    for q in rng.uniform(preview_case.unit.lower, preview_case.unit.upper, (20, 6)):
        T = np.eye(4)
        for joint, angle in zip(content["arm"]["chain"], q, strict=True):
            assert joint["revolute"]
            T = T @ _matrix(joint["T"]) @ transform(rotation(np.array(joint["axis"]) * angle))
        T = T @ _matrix(content["arm"]["T_end_tool"])
        assert np.abs(T - preview_case.robot_open.T_base_tool(q)).max() < 1e-6


def test_boards_stand_where_their_plates_do(preview_case) -> None:
    boards = [place.board for place in preview_case.boards]
    content = page_content(
        preview_case.plan,
        preview_case.robot_open,
        preview_case.robot_holding,
        preview_case.unit,
        boards=[*boards, replace(boards[0], name="09-10")],
    )
    assert [b["name"] for b in content["boards"]] == ["01-02", "03-04"]  # 09-10 is known, but not there
    for drawn, place in zip(content["boards"], preview_case.boards, strict=True):
        assert np.abs(_matrix(drawn["T"]) - place.T_base_board).max() < 1e-6
        assert drawn["markers"][1]["centre"] == pytest.approx(arm.board.SECOND_MARKER)


def test_hulls_are_drawn_with_triangles_that_close() -> None:
    drawn = shape_numbers(convex([(0, 0, 0), (0.1, 0, 0), (0, 0.1, 0), (0, 0, 0.1), (0.02, 0.02, 0.02)]))
    assert len(drawn["convex"]) == 4
    assert sorted(i for face in drawn["faces"] for i in face) == sorted([0, 1, 2, 3] * 3)
    assert shape_numbers(Capsule(0.1, 0.2)) == {"capsule": [0.1, 0.2]}


def test_marker_rows_are_opencvs() -> None:
    rows = marker_rows("DICT_4X4_50", 0)
    # the dictionary's marker 0, a known pattern, inside a black border
    assert rows == ["000000", "010110", "001010", "000110", "000100", "000000"]
    with pytest.raises(InputError, match=r"marker id = 50: must be from 0 to 49 in DICT_4X4_50"):
        marker_rows("DICT_4X4_50", 50)
    with pytest.raises(InputError, match=r"dictionary = 'CORNER_REFINE_NONE': must be one of .*DICT_4X4_50"):
        marker_rows("CORNER_REFINE_NONE", 0)


def test_samples_agree_with_a_body_in_the_way(preview_case) -> None:
    """A post at a known gap from the standing arm is what the samples of the first move begin with."""
    first = next(preview_case.plan.moves)
    q = preview_case.unit.positions(first.path.start)
    tip = preview_case.robot_open.T_base_tool(q)[:3, 3]
    ball = {
        "name": "ball",
        "kind": "wall",
        "shape": {"sphere": 0.01},
        "T_base_body": transform(t=tip + [0, 0, -0.015]).tolist(),
    }
    plan = replace(
        preview_case.plan,
        scene={**preview_case.plan.scene, "bodies": [*preview_case.plan.scene["bodies"], ball]},
    )
    samples = sample_clearance(
        plan, preview_case.robot_open, preview_case.robot_holding, preview_case.unit, every_s=1.0
    )
    start = samples[1][0]
    assert start.time_s == 0.0
    assert "ball" in start.pair
    gap = np.linalg.norm(start.points[1] - start.points[0])
    assert start.distance == pytest.approx(gap, abs=1e-6)
    # the open fingers stand 30 mm to each side of the tip, so the ball's centre is their distance away
    finger = np.hypot(0.03, 0.015)
    assert start.distance == pytest.approx(finger - 0.01, abs=1e-3)
    held = [i for i, s in enumerate(plan.steps) if isinstance(s, Move) and s.held == "cube 2"]
    assert any("cube 2" in s.pair for i in held for s in samples[i])


def test_samples_agree_with_the_planners_certificate(preview_case) -> None:
    """On a plan of the real planner: never below what is proved, and as low as it where a move is tightest."""
    case = preview_case
    source, target = case.boards
    stations = []
    for place in (source, target):
        in_hole = [
            place.T_base_board
            @ place.board.T_board_hole(2)
            @ transform(rot_x(np.pi) @ rot_z(yaw), (0.0, 0.0, 0.015))
            for yaw in np.radians([0.0, 90.0, 180.0, 270.0])
        ]
        stations.append(
            Station(f"{place.board.name}/3", tuple(in_hole), frozenset({plate_name(place.board.name)}))
        )
    scene = Scene(
        case.robot_open,
        case.robot_holding,
        tuple(body_from_json(b) for b in case.plan.scene["bodies"]),
        tuple(body_from_json(c) for c in case.plan.scene["cubes"]),
    )
    q_start = case.unit.positions(case.plan.start)
    plan = plan_task(scene, [Transfer("cube 3", *stations)], q_start, case.unit)
    sampled = sample_clearance(plan, case.robot_open, case.robot_holding, case.unit, every_s=0.1)
    moves = {i: step for i, step in enumerate(plan.steps) if isinstance(step, Move)}
    assert set(sampled) == set(moves)
    assert sum(move.held is not None for move in moves.values()) == 3
    for index, move in moves.items():
        least = min(s.distance for s in sampled[index])
        assert least >= move.clearance, move.name
        # the certificate is tight to 5 % or 0.5 mm; the samples lie up to 0.1 s beside the closest moment
        assert least <= 1.06 * move.clearance + 1.5e-3, move.name


def test_same_plan_same_bytes_and_under_the_size(preview_case, tmp_path: Path) -> None:
    text = _write(preview_case, tmp_path / "a.html")
    assert text == _write(preview_case, tmp_path / "b.html")
    assert len(text.encode()) <= 1_500_000
    assert preview_case.plan.sha256 in text
    assert "Permission is hereby granted, free of charge" in text  # three's licence goes with its code


def test_nothing_in_the_page_leads_out(preview_case, tmp_path: Path) -> None:
    text = _write(preview_case, tmp_path / "a.html")
    assert set(re.findall(r"https?://[\w./-]+", text)) <= {
        "http://www.w3.org/1999/xhtml",
        "http://www.w3.org/2000/svg",
    }  # names of XML vocabularies, not addresses
    assert not re.search(r"\b(?:src|href)\s*=\s*[\"'][^#\"']", text)
    assert "default-src 'none'" in text


def test_a_name_cannot_break_out_of_its_script(preview_case) -> None:
    evil = "</script><script>document.title='broken'</script><!--scripts-->"
    plan = replace(preview_case.plan, task={"name": evil})
    content = page_content(plan, preview_case.robot_open, preview_case.robot_holding, preview_case.unit)
    text = page(content)
    assert evil not in text
    embedded = re.search(r'<script id="content" type="application/json">(.*?)</script>', text, re.S)
    assert embedded is not None
    assert json.loads(embedded[1])["task"]["name"] == evil


def test_another_units_plan_is_refused(preview_case) -> None:
    with pytest.raises(InputError, match=r"unit = 'crs97': the plan is for 'crs93'"):
        page_content(
            preview_case.plan, preview_case.robot_open, preview_case.robot_holding, load_unit("crs97")
        )


def test_executed_motion_is_whole_counts(preview_case) -> None:
    first = next(preview_case.plan.moves)
    executed = ExecutedMove(1, np.array([0.0, 0.1]), first.path.at([0.0, 0.1]))
    content = page_content(
        preview_case.plan,
        preview_case.robot_open,
        preview_case.robot_holding,
        preview_case.unit,
        executed=[executed],
    )
    assert content["executed"][0]["counts"][0] == list(first.path.start)
    json.dumps(content, allow_nan=False)


def test_the_page_knows_what_is_checked(preview_case) -> None:
    """Paddings of links, of bodies and of cubes, so that it can draw every body as it is checked."""
    case = preview_case
    scene = {
        **case.plan.scene,
        "bodies": [{**b, "padding": 0.0015} for b in case.plan.scene["bodies"]],
        "cubes": [{**c, "padding": 0.002} for c in case.plan.scene["cubes"]],
    }
    arms = [padded(robot, 0.01, but=("palm",)) for robot in (case.robot_open, case.robot_holding)]
    content = page_content(replace(case.plan, scene=scene), *arms, case.unit)
    assert {b["padding"] for b in content["bodies"]} == {0.0015}
    assert {c["padding"] for c in content["cubes"]} == {0.002}
    links = {b["name"]: b["padding"] for b in content["arm"]["bodies"]}
    assert links.pop("palm") == 0.0
    assert set(links.values()) == {0.01}
