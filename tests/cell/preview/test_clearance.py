"""Clearances of a preview, compared with the planner's."""

from dataclasses import replace

import numpy as np
import pytest

from arm.board import plate_name
from arm.controller.segments import CountPath
from arm.plan_file import Move
from arm.robot.shapes import body_from_json
from arm.se3 import rot_x, rot_z, transform
from cell.preview import clearance
from cell.preview.clearance import sample_clearance
from cell.preview.content import page_content
from plan.program.tasks import plan_task
from plan.scene import Scene, Station, Transfer


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


def test_a_long_plan_has_no_more_samples_than_a_page_can_show(
    preview_case, monkeypatch: pytest.MonkeyPatch
) -> None:
    case = preview_case
    of_case = case.plan, case.robot_open, case.robot_holding, case.unit
    usual = sample_clearance(*of_case)
    monkeypatch.setattr(clearance, "MOST_SAMPLES", 60)
    few = sample_clearance(*of_case)
    assert few.keys() == usual.keys()
    assert sum(map(len, few.values())) <= 60 + 2 * len(few) < sum(map(len, usual.values()))
    for index, samples in few.items():  # each move keeps its begin and its end
        assert (samples[0].time_s, samples[-1].time_s) == (usual[index][0].time_s, usual[index][-1].time_s)
