"""The drawing, the polishing pass and the pallet of scenes: on the lines at every millisecond, and each place once."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from arm.errors import ImpossibleError
from arm.io.storage import data_file
from arm.plan_file import GripperStep
from arm.se3 import inverse
from cell.program.path_step import PathStep
from cell.program.planning import plan_of_program
from cell.program.program_file import read_program
from cell.program.svg import strokes_of
from cell.task.plan_matches import replayed, scene_of_now
from plan.verify import scenes_of_moves
from programs.pallets import samples_of_parts
from vision.observation import Observation

pytestmark = pytest.mark.slow


def test_the_pen_is_on_the_drawn_lines_at_every_millisecond() -> None:
    task = read_program(data_file("scenes/pen/drawing.toml"))
    plan = plan_of_program(task, Observation(), task.cell.speed)
    replayed(task, plan)
    moves = {move.name: move for move in plan.moves}
    robot, unit, T_work_base = task.cell.robot(), task.cell.unit, inverse(task.T_on_work)
    drawn = strokes_of(data_file("scenes/pen/drawing.svg"), 0.210)
    assert len(drawn) == len(task.steps) == 4
    for step, stroke in zip(task.steps, drawn, strict=True):
        assert isinstance(step, PathStep)
        path = moves[f"along {step.name}"].path
        times = np.arange(0.0, path.duration_s, 1e-3)
        tip = np.array([(T_work_base @ robot.T_base_tool(q))[:3, 3] for q in unit.positions(path.at(times))])
        off = np.min([piece.distances(tip) for piece in step.outline.pieces], axis=0)
        assert off.max() < 1e-4
        down = tip[tip[:, 2] < 1e-4]
        from_drawing = np.min([piece.distances(down) for piece in stroke.pieces], axis=0)
        assert (
            np.sort(from_drawing)[int(0.98 * len(down))] < 6e-4
        )  # rounded corners, and about 1 mm at both ends
        speed = np.linalg.norm(np.diff(tip, axis=0), axis=1) / 1e-3
        assert speed.max() < 1.01 * 0.060


def test_the_ball_is_on_its_lines_and_leans_as_far_as_it_may_beside_the_clamp() -> None:
    task = read_program(data_file("scenes/polish/pass.toml"))
    plan = plan_of_program(task, Observation(), task.cell.speed)
    replayed(task, plan)
    (step,) = task.steps
    assert isinstance(step, PathStep)
    path = next(move for move in plan.moves if move.name == f"along {step.name}").path
    robot, unit, T_work_base = task.cell.robot(), task.cell.unit, inverse(task.T_on_work)
    q = unit.positions(path.at(np.arange(0.0, path.duration_s, 1e-3)))
    ball = np.array([T_work_base @ robot.T_base_tool(one) for one in q])
    off = np.min([piece.distances(ball[:, :3, 3]) for piece in step.outline.pieces], axis=0)
    assert off.max() < 1e-4
    lean = np.degrees(np.arccos(-ball[:, 2, 2]))
    assert 1.0 < lean.max() < 25.1
    upright = replace(task, steps=(replace(step, tilt=0.0),))
    with pytest.raises(ImpossibleError, match=r"the nearest miss is spindle .* mm from clamp"):
        plan_of_program(upright, Observation(), task.cell.speed)


def test_every_place_of_the_pallet_is_filled_once_in_order_and_no_box_is_near_another() -> None:
    file = data_file("scenes/pallet.toml")
    assert len(file.read_text().splitlines()) <= 30
    task = read_program(file)
    plan = plan_of_program(task, Observation(), 1.0)
    replayed(task, plan)
    robot, T_work_base = task.cell.robot(), inverse(task.T_on_work)
    reached = {r["name"]: T_work_base @ robot.T_base_tool(np.array(r["q"])) for r in plan.task["reached"]}
    names = ["put", *(f"put ({k})" for k in range(2, 33))]
    assert [name for name in reached if name.startswith("put")] == names
    places = [(70 * i, 52 * j, 18 + 36 * k) for k in range(2) for j in range(4) for i in range(4)]
    np.testing.assert_allclose([1e3 * reached[name][:3, 3] for name in names], places, atol=0.1)
    jaws = [step.action for step in plan.steps if isinstance(step, GripperStep)]
    assert jaws == ["close", "open"] * 32
    boxes = [f"part {k}" for k in range(1, 33)]
    scene = scene_of_now(task, plan)
    assert [cube.name for cube in scene.cubes] == boxes
    last = list(scenes_of_moves(plan, scene, task.cell.unit))[-1]
    stand = {body.name: (T_work_base @ body.T_base_body)[:3, 3] for body in last.resting}
    np.testing.assert_allclose([1e3 * stand[name] for name in boxes], places, atol=0.1)
    least = samples_of_parts(task, plan, 0.02)
    assert min(least.values()) > 0.005
    assert min(move.clearance for move in plan.moves) >= 0.005
