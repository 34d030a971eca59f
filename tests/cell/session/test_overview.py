"""What of a plan is told before it moves."""

from __future__ import annotations

import numpy as np
import pytest

from cell.session.overview import overview


def test_ranges_and_speeds_are_those_of_what_is_sent(preview_case) -> None:
    plan, robot, unit = preview_case.plan, preview_case.robot_open, preview_case.unit
    of = overview(plan, robot, unit)
    knots = unit.positions(np.concatenate([move.path.knots() for move in plan.moves]))
    assert (of.lowest <= knots.min(axis=0) + 1e-9).all()
    assert (of.highest >= knots.max(axis=0) - 1e-9).all()
    fine = [unit.positions(move.path.sample(1e-3)) for move in plan.moves]
    velocity = np.array([np.abs(np.diff(q, axis=0)).max(axis=0) / 1e-3 for q in fine]).max(axis=0)
    assert of.fastest == pytest.approx(velocity, rel=0.02)
    assert of.travel == pytest.approx(
        np.sum([np.abs(np.diff(q, axis=0)).sum(axis=0) for q in fine], axis=0), rel=1e-3
    )
    tips = [np.array([robot.T_base_tool(x)[:3, 3] for x in q[::20]]) for q in fine]
    speed = max(float(np.linalg.norm(np.diff(p, axis=0), axis=1).max()) for p in tips) / 0.02
    assert of.tool == pytest.approx(speed, rel=0.02)
    assert of.clearance == min(move.clearance for move in plan.moves)
