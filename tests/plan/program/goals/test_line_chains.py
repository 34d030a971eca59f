"""Lines of a list: what is free stays as it is, or goes around what is near where the plain line is refused."""

from __future__ import annotations

import numpy as np
import pytest

from arm.controller.unit import Unit
from arm.errors import ImpossibleError
from arm.io.storage import data_file
from arm.robot.model import Robot
from arm.se3 import angle_between, rot_x, rot_z, transform
from arms.mujoco_cell import MujocoCell
from plan.kinematics.numeric_ik import SearchOptions
from plan.options import PlanOptions
from plan.program.goals.line_chains import LineChains, _nearest, _turns
from plan.program.goals.target import Target
from plan.program.pose_lists import plan_poses
from plan.program.sequence.planner import SearchEffort
from plans.barred_lines import hole_scene
from tasks.pose_lists import TABLE, check_plan, down

EFFORT = SearchEffort(candidates=16, ik=SearchOptions(samples=24))
Q_HOME = np.radians([-60, -35, -85, 0, -60, 0])


def test_a_line_keeps_what_is_free_as_it_is() -> None:
    T, now = down(0.4, 0.1, 0.2), down(0.5, 0.3, 0.25) @ transform(rot_x(0.3)) @ transform(rot_z(0.4))
    shifted = _nearest(now, Target("t", T, free=("x", "y")))
    np.testing.assert_allclose(shifted[:3, 3], (0.5, 0.3, 0.2), atol=1e-12)
    np.testing.assert_allclose(shifted[:3, :3], T[:3, :3], atol=1e-12)
    turned = _nearest(now, Target("t", T, free="rz"))
    np.testing.assert_allclose(turned[:3, 2:], T[:3, 2:], atol=1e-12)
    nearest = angle_between(turned[:3, :3], now[:3, :3])
    for angle in (-0.01, 0.01):
        assert angle_between(turned[:3, :3] @ rot_z(angle), now[:3, :3]) > nearest
    np.testing.assert_allclose(
        _nearest(now, Target("t", T, free=("rx", "ry", "rz")))[:3, :3], now[:3, :3], atol=1e-9
    )


def test_what_a_line_leaves_free_turns_if_the_tool_axis_stays() -> None:
    T = down(0.4, 0.1, 0.2)
    both = Target("both", T, free=("rx", "rz", "x"), by="line")
    assert _turns(both, "line") == "xz"
    assert _turns(both, "approach") == _turns(both, "retract") == "z"
    near = Target("near", T, free="rz", by="line", approach=0.1, allowed_collisions={("cube", "plate")})
    assert _turns(near, "line") == "z"
    assert _turns(near, "approach") is None  # where something may touch
    assert _turns(Target("held", T, free="rx", by="line", approach=0.1), "line") is None
    assert _turns(Target("fixed", T, by="line"), "line") is None


@pytest.mark.parametrize(("seed", "solver"), [(2, "daqp"), (2, "osqp"), (5, "daqp")])
def test_an_approach_turns_between_a_post_and_a_plate(
    robot: Robot, crs97: Unit, seed: int, solver: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    at, bodies = hole_scene(seed)
    hole = Target("hole", transform(rot_x(np.pi), at), free="rz", approach=0.15, retract=0.15)
    options = PlanOptions(speed=1.0, solver=solver)

    def planned():  # type: ignore[no-untyped-def]
        return plan_poses(
            robot, [TABLE, *bodies], [hole], Q_HOME, crs97.limits(), q_end=Q_HOME, options=options,
            effort=EFFORT,
        )  # fmt: skip

    with monkeypatch.context() as blind:
        blind.setattr(LineChains, "can_bend", False)
        with pytest.raises(ImpossibleError, match=r"approach with .* too near to"):
            planned()
    plan = planned()
    check_plan(plan, [hole], crs97.limits())
    lines = [m for m in plan.moves if m.role in ("approach", "retract")]
    assert [m.role for m in lines] == ["approach", "retract"]
    judge = MujocoCell(data_file("urdf/a465/a465.urdf"), [TABLE, *bodies], [], robot.disabled_collisions)
    pairs = [pair for pair in judge.pairs() if frozenset(pair) not in robot.disabled_collisions]
    turned = 0.0
    for move in lines:
        q = plan.unit.positions(move.path.sample(0.02))
        tool = np.stack([robot.T_base_tool(one) for one in q])
        assert np.abs(tool[:, :2, 3] - at[:2]).max() < 1e-4
        assert np.abs(tool[:, 2, 2] + 1.0).max() < 1e-6
        for one in q:
            judge.place(one, 0.06, {})
            assert min(judge.distance(*pair, 0.2) for pair in pairs) >= move.clearance - 2e-6
        assert move.clearance >= options.line_clearance
        turned = max(turned, float(np.ptp(q[:, 5])))
    assert turned > 0.1


def test_where_something_may_touch_nothing_turns(robot: Robot, crs97: Unit) -> None:
    at, bodies = hole_scene(5)
    hole = Target(
        "hole",
        transform(rot_x(np.pi), at),
        free="rz",
        approach=0.15,
        allowed_collisions={("finger_l", "plate")},
    )
    with pytest.raises(ImpossibleError, match=r"approach with .* too near to post"):
        plan_poses(
            robot,
            [TABLE, *bodies],
            [hole],
            Q_HOME,
            crs97.limits(),
            options=PlanOptions(speed=1.0),
            effort=EFFORT,
        )
