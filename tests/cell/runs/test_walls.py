"""A wall in the cell file that blocks the straight joint move: the plan goes around it, certified."""

from __future__ import annotations

from pathlib import Path

import pytest

from cell.files.task import read_task
from cell.scene.build import build_scene
from cell.task.planning import Rest, plan_rest
from plan.collision.bezier import curve_of_waypoints
from plan.collision.certificate import certify_curve
from plan.collision.world import World
from tasks.true_look import true_look

WALL = '\n[[walls]]\nname = "post"\ncentre_mm = [340, -365, 100]\nsize_mm = [30, 30, 200]\n'


@pytest.mark.slow
def test_a_wall_in_the_way_is_gone_around(scenes: Path) -> None:
    free = read_task(scenes / "task2.toml")
    (scenes / "cell.toml").write_text((scenes / "cell.toml").read_text() + WALL)
    walled = read_task(scenes / "task2.toml")
    plans = [plan_rest(Rest(t, true_look(t), t.cell.q_start, 0.5)) for t in (free, walled)]
    assert plans[0] is not None
    assert plans[1] is not None
    world = World(walled.cell.robot(), build_scene(walled.cell, true_look(walled)).bodies)
    first = next(plans[0].moves)
    ends = walled.cell.unit.positions(first.path.knots()[[0, -1]])
    straight = certify_curve(world, curve_of_waypoints(ends), walled.cell.clearance)
    assert not straight.proved
    assert "post" in straight.pair
    for move in plans[1].moves:
        assert move.certified
        assert move.clearance >= (0.010 if move.role in ("transit", "home") else 0.005)
    assert plans[1].duration_s < 1.3 * plans[0].duration_s
