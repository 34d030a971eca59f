"""Steps of a plan on one clock, and where cubes are meanwhile."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from arm.errors import InputError
from arm.plan_file import GripperStep, Move
from arm.robot.shapes import body_from_json
from arm.se3 import inverse
from cell.export.timeline import LOOK_S, cube_tracks, timed_steps
from cell.preview.content import page_content


def test_one_clock_without_gaps(preview_case) -> None:
    steps = timed_steps(preview_case.plan)
    assert steps[0].start_s == 0.0
    for before, after in pairwise(steps):
        assert before.end_s == after.start_s
        assert before.jaws[1] == after.jaws[0]
    waits = sum(s.settle_s for s in preview_case.plan.steps if isinstance(s, GripperStep))
    assert steps[-1].end_s == pytest.approx(preview_case.plan.duration_s + waits + 4 * LOOK_S)


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
