"""Lines of a list: what is free stays as it is, or goes around what is near where the plain line is refused."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from arm.controller.unit import Limits, Unit
from arm.errors import ImpossibleError
from arm.io.storage import data_file
from arm.robot.model import Robot
from arm.robot.shapes import Body, Sphere
from arm.se3 import Array, angle_between, rot_x, rot_z, rotation, transform
from arms.mujoco_cell import MujocoCell
from plan.cartesian.clear_line import ClearLine
from plan.cartesian.line import Line, LineOptions, follow_line
from plan.collision.certificate import ClearanceCertificate
from plan.collision.world import World
from plan.kinematics.ik import inverse_kinematics
from plan.kinematics.numeric_ik import SearchOptions
from plan.options import PlanOptions
from plan.program.goals import line_chains
from plan.program.goals.attachments import AttachmentWorlds
from plan.program.goals.line_chains import LineChains, TargetReached, _nearest, _turns
from plan.program.goals.target import Target
from plan.program.pose_lists import plan_poses
from plan.program.sequence.planner import SearchEffort
from plan.program.setting import Setting
from plan.scene import Scene
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


CUP = Body("cup", Sphere(0.02), transform(t=(0.4, -0.2, 0.08)), "cube")
TOUCHING = {("cup", "finger_l"), ("cup", "table")}
TURNED = transform(rot_z(1.0))  # far from the limits of J6


def chains_of(robot: Robot, unit: Unit, targets: list[Target], bends: bool) -> LineChains:
    scene = Scene(robot, robot, (TABLE,), (CUP,))
    setting = Setting(scene, unit, unit.limits(), PlanOptions())
    return LineChains(setting, AttachmentWorlds(scene, targets), bends)


def first_of(robot: Robot, unit: Unit, target: Target) -> Array:
    """The solution nearest to home."""
    limits = unit.limits()
    found = inverse_kinematics(robot, target.poses[0], limits.lower, limits.upper).q
    return min(found, key=lambda q: float(np.abs(q - Q_HOME).max()))


@pytest.mark.parametrize("seed", range(4))
def test_lines_lead_to_and_from_their_targets_at_their_speed(robot: Robot, crs97: Unit, seed: int) -> None:
    """An approach comes from behind the pose along the tool's axis, a retract goes back there."""
    rng = np.random.default_rng(seed)
    lengths, speed = rng.uniform(0.02, 0.08, (2, 2)), rng.uniform(0.01, 0.2)
    poses = [
        down(*rng.uniform((0.35, y, 0.1), (0.45, y + 0.1, 0.2)))
        @ transform(rot_z(1.0) @ rotation(rng.uniform(-0.2, 0.2, 3)))
        for y in (-0.2, 0.1)
    ]
    targets = [
        Target(name, T, by=by, approach=a, retract=r, speed=v)
        for name, T, by, (a, r), v in zip(
            "ab", poses, ("transit", "line"), lengths, (speed, None), strict=True
        )
    ]
    chains = chains_of(robot, crs97, targets, bends=False)
    made = chains.chain(range(2), first_of(robot, crs97, targets[0]), "")
    behind = [
        [T @ transform(t=(0.0, 0.0, -length)) for length in row]
        for T, row in zip(poses, lengths, strict=True)
    ]
    way = [behind[0][0], poses[0], behind[0][1], behind[1][0], poses[1], behind[1][1]]
    assert [line.role for line in made.lines] == ["approach", "retract", "line", "approach", "retract"]
    for line, ends in zip(made.lines, pairwise(way), strict=True):
        for at, T, q in zip(ends, (line.line.T_start, line.line.T_end), line.path.q[[0, -1]], strict=True):
            np.testing.assert_allclose(T, at, atol=1e-4)
            np.testing.assert_allclose(robot.T_base_tool(q), T, atol=1e-4)
        assert line.speed == (speed if line.target == 0 else chains.setting.tool_speed)
    for item in made.items:
        if isinstance(item, TargetReached):  # as it is sent
            assert np.array_equal(crs97.positions(crs97.counts(item.q)), item.q)
            assert np.array_equal(robot.T_base_tool(item.q), item.T_base_tool)


@pytest.mark.parametrize("bends", [False, True])
def test_lines_bend_in_the_world_of_their_time(
    robot: Robot, crs97: Unit, bends: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A retract with a body in the jaws is no approach without it; only the target's own lines may touch."""
    pick = Target(
        "pick",
        down(0.4, -0.2, 0.1) @ TURNED,
        approach=0.05,
        retract=0.05,
        attach="cup",
        allowed_collisions=TOUCHING,
    )
    put = Target("put", down(0.4, 0.0, 0.15) @ TURNED, by="line", retract=0.05, detach=True)
    chains, seen = chains_of(robot, crs97, [pick, put], bends), list[tuple[bool, bool, float]]()

    def plain(
        world: World,
        clearance: float,
        q: Array,
        line: Line,
        limits: Limits,
        options: LineOptions,
        turns: str | None,
        end: float,
    ) -> ClearLine:
        pairs = {frozenset(world.pair_names(i)) for i in range(len(world.pairs))}
        may_touch = not pairs & {frozenset(pair) for pair in TOUCHING}
        seen.append((world.joint_of("cup") == robot.end_joint, may_touch, end))
        path = follow_line(robot, q, line.T_start, line.T_end, limits, options)
        return ClearLine(path, options.free_axis, ClearanceCertificate(1.0, 1.0, ("", ""), 0.0, True, 1))

    monkeypatch.setattr(line_chains, "follow_clear_line", plain)
    made = chains.chain(range(2), first_of(robot, crs97, pick), "")
    assert [line.role for line in made.lines] == ["approach", "retract", "line", "retract"]
    offset = PlanOptions().clearance  # transits begin and end there
    expected = [(False, True, offset), (True, True, offset), (True, False, 0.0), (False, False, offset)]
    assert seen == (expected if bends else [])


@pytest.mark.few(1)
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
