"""Lists of poses, on the A465 and on arms of other kinds, judged by forward kinematics and MuJoCo."""

from __future__ import annotations

import itertools
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from arm.bodies import Body, Box, Cylinder, Sphere, convex
from arm.errors import ImpossibleError, InputError
from arm.outfit import urdf_limits
from arm.robot import Robot
from arm.se3 import angle_between, inverse, rot_x, rot_z, rotation_vector, transform
from arm.unit import Unit
from made_up_arms import RAIL, SEVEN, UR_LIKE, MujocoArm, arm
from mujoco_cell import MujocoCell
from plan.chains import _nearest
from plan.check import check_move
from plan.extremes import segment_extremes
from plan.handling import Worlds
from plan.ik_numeric import FREE, SearchOptions, solve_ik
from plan.options import PlanOptions
from plan.poselist import SearchEffort, _Problem, plan_poses
from plan.posemotion import Piece, PoseMover
from plan.poseplan import Pause, PosePlan
from plan.posesearch import PoseSearch
from plan.straight import Line
from plan.targets import Target
from plan.world import World

DOWN = rot_x(np.pi)
TABLE = Body("table", Box((1.6, 1.6, 0.04)), transform(t=(0.0, 0.0, -0.06)), "table")
FAST = PlanOptions(speed=1.0)
EFFORT = SearchEffort(candidates=10, ik=SearchOptions(starts=48, samples=16))


def down(x: float, y: float, z: float) -> np.ndarray:
    return transform(DOWN, (x, y, z))


def rock() -> Body:
    """A mesh: the hull of 30 random points on a ball."""
    points = np.random.default_rng(5).normal(size=(30, 3))
    points *= 0.09 / np.linalg.norm(points, axis=1)[:, None]
    return Body("rock", convex(points), transform(t=(0.42, 0.0, 0.2)), "rock")


def off(plan: PosePlan, targets: list[Target]) -> np.ndarray:
    """Largest error on constrained directions per target, m and rad; of two free turns the rotation vector counts."""
    found = []
    for target, reached in zip(targets, plan.reached, strict=True):
        T = inverse(target.T_base_tool) @ plan.robot.T_base_tool(reached.q)
        turns = [k for k in range(3) if FREE[3 + k] in target.free]
        turn = rotation_vector(T[:3, :3])
        if len(turns) == 1:  # the free axis itself has to be where it was
            turn = np.cross(T[:3, turns[0]], np.eye(3)[turns[0]])
        held = [k for k in range(6) if FREE[k] not in target.free]
        found.append(np.abs(np.concatenate([T[:3, 3], turn])[held]).max(initial=0.0))
    return np.array(found)


def check_plan(plan: PosePlan, targets: list[Target], limits, exact: float = 1e-5) -> None:  # type: ignore[no-untyped-def]
    """What holds for every plan."""
    assert off(plan, targets).max() < exact
    times, q = plan.sample(0.005)
    # every target is passed in order, and the plan is without jumps
    first = 0
    for reached, target in zip(plan.reached, targets, strict=True):
        away = np.abs(q - reached.q).max(axis=1)
        if target.within == 0.0:
            hits = np.flatnonzero(away[first:] < 0.02)
            assert len(hits)
            first += int(hits[0])
    assert np.abs(np.diff(q, axis=0) / np.diff(times)[:, None] / limits.velocity).max() <= 1.0 + 1e-6
    for before, after in itertools.pairwise(plan.moves):
        assert before.path.end == after.path.start
    for move in plan.moves:
        extremes = segment_extremes(move.path, plan.unit)
        assert (extremes.velocity <= limits.velocity * (1 + 1e-9)).all()
        assert (extremes.acceleration <= limits.acceleration * (1 + 1e-9)).all()
        assert (extremes.lower >= limits.lower - 1e-6).all()
        assert (extremes.upper <= limits.upper + 1e-6).all()
        assert move.certified
    assert plan.lower_bound_s <= plan.duration_s
    np.testing.assert_allclose(q[-1], plan.unit.positions(plan.moves[-1].path.end), atol=1e-12)


def hovering(robot: Robot, limits, bodies: list[Body], T: np.ndarray) -> np.ndarray:  # type: ignore[no-untyped-def]
    """The solution for a pose that is nearest to zero and clear of all."""
    world = World(robot, bodies)
    found = [q for q in solve_ik(robot, T, limits.lower, limits.upper).q if not world.in_collision(q, 0.02)]
    return np.asarray(min(found, key=lambda q: round(float(np.abs(q).sum()), 6)))


@pytest.fixture(scope="module")
def row(robot: Robot, crs97: Unit) -> tuple[PosePlan, list[Target]]:
    """Three poses on either side of a wall, with a line and a pause."""
    bodies = [TABLE, Body("wall", Box((0.4, 0.02, 0.3)), transform(t=(0.5, 0.0, 0.15)), "wall")]
    targets = [
        Target("a", down(0.45, -0.2, 0.1), free="rz", approach=0.05, retract=0.05),
        Target("b", down(0.45, 0.2, 0.1), free="rz", approach=0.05, retract=0.05, dwell_s=0.5),
        Target("c", down(0.35, 0.25, 0.15), free="rz"),
        Target("d", down(0.35, 0.15, 0.15), free="rz", by="line", within=0.003),
        Target("e", down(0.42, 0.15, 0.15), by="line", free="rz"),
    ]
    plan = plan_poses(
        robot,
        bodies,
        targets,
        np.radians([-35, -35, -85, 0, -60, 0]),
        crs97.limits(),
        options=FAST,
        effort=EFFORT,
    )
    return plan, targets


def test_poses_are_reached_within_limits(row: tuple[PosePlan, list[Target]], crs97: Unit) -> None:
    plan, targets = row
    check_plan(plan, targets, crs97.limits())
    assert [s.target for s in plan.steps if isinstance(s, Pause)] == ["b"]
    assert plan.clearance >= FAST.line_clearance


def test_lines_are_straight_and_corners_cut_as_allowed(row: tuple[PosePlan, list[Target]]) -> None:
    plan, targets = row
    T = {r.target: r.T_base_tool for r in plan.reached}

    def tool(name: str) -> np.ndarray:
        move = next(m for m in plan.moves if m.name == name)
        q = plan.unit.positions(move.path.sample(0.005))
        return np.stack([plan.robot.T_base_tool(x) for x in q])

    lowering = tool("approach to a")
    line = Line(transform(T["a"][:3, :3], T["a"][:3, 3] - 0.05 * T["a"][:3, 2]), T["a"])
    assert line.deviation(lowering).distance.max() < 1e-5
    assert line.deviation(lowering).angle.max() < 1e-4
    cut = tool("line to d .. line to e")[:, :3, 3]
    corner = targets[3].T_base_tool[:3, 3]
    nearest = np.linalg.norm(cut - corner, axis=1).min()
    assert 1e-4 < nearest <= 0.003
    away = [
        Line(targets[i].T_base_tool, targets[i + 1].T_base_tool)
        .deviation(tool("line to d .. line to e"), "z")
        .distance
        for i in (2, 3)
    ]
    assert np.min(away, axis=0).max() < 0.003


def test_the_clearance_is_there_in_mujoco(row: tuple[PosePlan, list[Target]]) -> None:
    from arm.files import data_file

    plan, _ = row
    bodies = [TABLE, Body("wall", Box((0.4, 0.02, 0.3)), transform(t=(0.5, 0.0, 0.15)), "wall")]
    cell = MujocoCell(data_file("urdf/a465/a465.urdf"), bodies, [], plan.robot.touching)
    pairs = [p for p in cell.pairs() if frozenset(p) not in plan.robot.touching]
    for move in plan.moves:
        seen = np.inf
        for q in plan.unit.positions(move.path.sample(0.1)):
            cell.place(q, 0.06, {})
            seen = min(seen, *(cell.distance(*pair, 0.2) for pair in pairs))
        assert seen >= move.clearance - 2e-6


def test_the_same_in_the_counts_of_a_unit_and_twice_the_same(robot: Robot, crs97: Unit) -> None:
    targets = [Target("a", down(0.45, -0.2, 0.1), approach=0.05), Target("b", down(0.4, 0.2, 0.2))]
    q = np.radians([-35, -35, -85, 0, -60, 0])

    def made() -> PosePlan:
        return plan_poses(robot, [TABLE], targets, q, crs97.limits(), unit=crs97, q_end=q, options=FAST)

    plan = made()
    check_plan(plan, targets, crs97.limits(), exact=1e-4)  # whole counts
    assert plan.moves[0].path.start == plan.moves[-1].path.end == tuple(crs97.counts(q).tolist())
    world = Worlds(robot, [TABLE], targets, 0.0)
    for move in plan.moves:
        assert check_move(world.world(world.start), move.path, crs97, move.clearance - 1e-6).proved
    assert json.dumps(plan.to_json()) == json.dumps(made().to_json())


def test_the_sequence_is_the_best_of_all(robot: Robot, crs97: Unit) -> None:
    """Every sequence of candidates is walked through, with the same costs."""
    bodies = [TABLE, Body("post", Cylinder(0.03, 0.5), transform(t=(0.42, 0.02, 0.2)), "post")]
    targets = [
        Target("a", down(0.45, -0.2, 0.1), free="rz", approach=0.05, retract=0.05),
        Target("b", down(0.45, 0.2, 0.12), free="rz"),
        Target("c", down(0.3, -0.25, 0.2), free="rz", approach=0.04),
    ]
    effort = SearchEffort(candidates=3, detours=99, ik=SearchOptions(samples=8))
    found: list[PoseSearch] = []

    class Spy(_Problem):
        def moved(self, search: PoseSearch):  # type: ignore[no-untyped-def]
            found.append(search)
            return super().moved(search)

    q = np.radians([-35, -35, -85, 0, -60, 0])
    problem = Spy(robot, bodies, targets, crs97.limits(), _grid(robot, crs97), FAST, effort, 0.0)
    plan = problem.solved(problem.standing("q_start", q), None)
    search = found[-1]
    best = search.best()
    from plan.posesearch import _State

    times = {}
    for indices in itertools.product(*(range(len(layer.chains)) for layer in search.layers[1:])):
        state: _State | None = _State(0, 0, search.worlds.start, 0.0, ())
        for index in indices:
            state = search._taken(state, index) if state is not None else None
        if state is not None:
            times[indices] = state.cost
    assert len(times) > 8
    assert plan.detours > 0
    assert best.time == pytest.approx(min(times.values()), abs=1e-9)
    assert max(times.values()) > best.time + 0.1
    assert search.bound() <= min(times.values())
    assert plan.lower_bound_s <= plan.duration_s < 1.5 * plan.lower_bound_s


def _grid(robot: Robot, unit: Unit) -> Unit:
    from plan.grid import fine_grid

    return fine_grid(robot, unit.limits())


def _judged(plan: PosePlan, judge: MujocoArm, least: float) -> None:
    for move in plan.moves:
        q = plan.unit.positions(move.path.sample(0.05))
        seen = min(judge.least(x) for x in q)
        assert seen >= min(move.clearance, 0.1) - 2e-6, move.name
        assert move.clearance >= least


def test_an_arm_without_a_spherical_wrist_around_a_mesh(tmp_path: Path) -> None:
    robot = arm(tmp_path, UR_LIKE, [("l0", "l2")])
    limits = urdf_limits(robot, 4.0)
    bodies = [TABLE, rock()]
    q = hovering(robot, limits, bodies, down(0.3, -0.35, 0.35))
    targets = [
        Target("left", down(0.42, -0.22, 0.2), free="rz", approach=0.05),
        Target("over", down(0.42, 0.0, 0.36), free="rz", by="line", within=0.02),
        Target("right", down(0.42, 0.22, 0.2), free="rz", by="line"),
        Target("back", down(0.42, -0.2, 0.25), free=("rz", "z")),
    ]
    plan = plan_poses(robot, bodies, targets, q, limits, options=FAST, effort=EFFORT)
    check_plan(plan, targets, limits)
    _judged(plan, MujocoArm(tmp_path / "arm.urdf", robot, bodies), FAST.line_clearance)


def test_a_seven_joint_arm_carries_a_body_past_a_mesh(tmp_path: Path) -> None:
    robot = arm(tmp_path, SEVEN, [("l0", "l2"), ("l2", "l4"), ("l4", "l6")])
    limits = urdf_limits(robot, 4.0)
    stone = Body("stone", Sphere(0.03), transform(t=(0.4, -0.25, 0.1)), "cube")
    bodies = [TABLE, replace(rock(), T_base_body=transform(t=(0.45, 0.0, 0.12))), stone]
    touching = {("stone", "l7")}
    targets = [
        Target(
            "pick",
            down(0.4, -0.25, 0.1),
            free="rz",
            approach=0.1,
            retract=0.1,
            attach="stone",
            touching=touching,
        ),
        Target(
            "place",
            down(0.35, 0.3, 0.15),
            free="rz",
            approach=0.1,
            retract=0.1,
            detach=True,
            touching=touching,
        ),
    ]
    q = np.array([0.0, 0.3, 0.0, 1.5, 0.0, 1.2, 0.0])
    plan = plan_poses(robot, bodies, targets, q, limits, q_end=q, options=FAST, effort=EFFORT)
    check_plan(plan, targets, limits)
    assert [(s.target, s.attached, s.detached) for s in plan.steps if isinstance(s, Pause)] == [
        ("pick", "stone", None),
        ("place", None, "stone"),
    ]
    # MuJoCo, with the stone where it is at each instant
    judge = MujocoArm(tmp_path / "arm.urdf", robot, bodies)
    held, T = None, stone.T_base_body
    T_tool_held = inverse(plan.reached[0].T_base_tool) @ T
    for step in plan.steps:
        if isinstance(step, Pause):
            held = step.attached
            continue
        assert step.held == held
        allowed = frozenset(map(frozenset, touching)) if step.role != "transit" else frozenset()
        times = np.append(np.arange(0.0, step.path.duration_s, 0.1), step.path.duration_s)
        for x in plan.unit.positions(step.path.at(times)):
            T = robot.T_base_tool(x) @ T_tool_held if held else T
            assert judge.least(x, held, {"stone": T}, allowed) >= min(step.clearance, 0.1) - 2e-6
    np.testing.assert_allclose(T[:3, 3], (0.35, 0.3, 0.15), atol=1e-5)


def test_five_joints_and_a_rail(tmp_path: Path) -> None:
    robot = arm(tmp_path, RAIL, [("l1", "l3")])
    limits = urdf_limits(robot, {"q1": 1.0, "q2": 3.0, "q3": 3.0, "q4": 3.0, "q5": 3.0})
    bodies = [TABLE, Body("post", Cylinder(0.03, 0.4), transform(t=(0.4, 0.0, 0.15)), "post")]
    targets = [
        Target("a", down(0.4, -0.3, 0.2), free=("rx", "rz")),
        Target("b", down(0.4, 0.3, 0.2), free=("rx", "rz")),
    ]
    plan = plan_poses(robot, bodies, targets, np.zeros(5), limits, options=FAST, effort=EFFORT)
    assert off(plan, targets).max() < 1e-5
    check_plan(plan, targets, limits)
    _judged(plan, MujocoArm(tmp_path / "arm.urdf", robot, bodies), FAST.clearance)


def test_export(row: tuple[PosePlan, list[Target]]) -> None:
    plan, _ = row
    header, *rows = plan.rows(0.02)
    assert header == ["time_s", "J1", "J2", "J3", "J4", "J5", "J6"]
    assert rows[-1][0] == pytest.approx(plan.duration_s)
    value = json.loads(json.dumps(plan.to_json()))
    # the cubics alone give the same motion
    q, t = [], []
    begin = 0.0
    for step in value["steps"]:
        for segment in step.get("segments", ()):
            c = np.array(segment["coefficients_rad"])
            q.append(c[0] + 0.3 * (c[1] + 0.3 * (c[2] + 0.3 * c[3])))
            t.append(begin + 0.3 * segment["duration_s"])
            begin += segment["duration_s"]
        begin += step.get("dwell_s", 0.0)
    assert begin == pytest.approx(plan.duration_s)
    np.testing.assert_allclose(plan.at(t), q, atol=1e-9)


def _refused(
    robot: Robot, unit: Unit, bodies: list[Body], *targets: Target, **more: object
) -> ImpossibleError:
    with pytest.raises(ImpossibleError) as caught:
        plan_poses(
            robot, bodies, targets, np.radians([-60, -35, -85, 0, -60, 0]), unit.limits(), options=FAST,
            effort=replace(EFFORT, candidates=4, detours=1), **more,
        )  # fmt: skip
    return caught.value


def test_refusals_say_what_and_how_much(robot: Robot, crs97: Unit) -> None:
    far = _refused(robot, crs97, [TABLE], Target("far", down(1.2, 0.0, 0.3)))
    assert "target 'far' at (1200, 0, 300) mm is out of reach" in str(far)
    assert far.data["outside_m"] > 0.1

    low = _refused(robot, crs97, [TABLE], Target("low", down(0.45, 0.1, -0.055), free="rz"))
    assert "all" in str(low)
    assert "finger_" in str(low)
    assert low.data["pair"][1] == "table"
    assert low.data["distance_m"] < 0.0

    close = _refused(robot, crs97, [TABLE], Target("close", down(0.45, 0.1, -0.036), approach=0.05))
    assert close.data["target"] == "close"

    out = _refused(
        robot, crs97, [TABLE], Target("a", down(0.45, 0.1, 0.2)), Target("b", down(0.95, 0.1, 0.2), by="line")
    )
    assert "from none of" in str(out)
    assert "line at 'b'" in str(out)
    assert out.data["done_m"] > 0.05

    cage = [TABLE, Body("cage", Box((0.9, 0.02, 1.0)), transform(t=(0.58, 0.0, 0.45)), "wall")]
    cage.append(Body("back", Box((0.9, 0.02, 1.0)), transform(t=(-0.58, 0.0, 0.45)), "wall"))
    cage.append(Body("lid", Box((2.0, 2.0, 0.02)), transform(t=(0.0, 0.0, 0.7)), "wall"))
    at = robot.T_base_tool(np.radians([-60, -35, -85, 0, -60, 0]))
    pressed = _refused(
        robot, crs97, [Body("ball", Sphere(0.02), at, "post")], Target("a", down(0.3, 0.35, 0.2))
    )
    assert "q_start: palm is" in str(pressed)
    assert pressed.data["pair"][1] == "ball"
    stuck = _refused(robot, crs97, cage, Target("other side", down(0.3, 0.35, 0.2)))
    assert "no way on to other side" in str(stuck)
    assert stuck.data["pair"][1] in ("cage", "back", "lid")
    assert sum(stuck.data["refused"].values()) >= 1


@pytest.mark.parametrize(
    ("targets", "says"),
    [
        ([], "at least one"),
        ([Target("a", np.eye(4)), Target("a", np.eye(4))], "two are named 'a'"),
        ([Target("a", np.eye(4), attach="cup")], "attach = 'cup': must be one of table"),
        ([Target("a", np.eye(4), detach=True)], "nothing moves with the tool"),
        ([Target("a", np.eye(4), touching={("table", "thumb")})], "touching = 'thumb'"),
    ],
)
def test_wrong_lists(robot: Robot, crs97: Unit, targets: list[Target], says: str) -> None:
    with pytest.raises(InputError, match=says):
        plan_poses(robot, [TABLE], targets, np.zeros(6), crs97.limits())


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"free": "yaw"}, "free = 'yaw': must be of x, y"),
        ({"by": "air"}, "by = 'air': must be one of transit, line"),
        ({"approach": -0.1}, "approach = -0.1"),
        ({"T_base_tool": 2 * np.eye(4)}, "target 'a': T_base_tool"),
        ({"touching": [("a",)]}, "pairs of two names"),
    ],
)
def test_wrong_targets(change: dict[str, object], says: str) -> None:
    with pytest.raises(InputError, match=says):
        Target(**{"name": "a", "T_base_tool": np.eye(4), **change})


def test_a_start_outside_limits_is_told(robot: Robot, crs97: Unit) -> None:
    with pytest.raises(InputError, match=r"q_start: joint J2 = 171\.89 deg: must be from"):
        plan_poses(robot, [], [Target("a", down(0.4, 0.0, 0.3))], [0, 3, 0, 0, 0, 0], crs97.limits())


def test_what_is_carried_stands_where_it_was_brought(robot: Robot) -> None:
    cup = Body("cup", Sphere(0.02), transform(t=(0.4, -0.2, 0.1)), "cube")
    pick = Target("pick", down(0.4, -0.2, 0.12), attach="cup")
    place = Target("place", down(0.4, 0.2, 0.22), detach=True)
    worlds = Worlds(robot, [TABLE, cup], [pick, place], 0.0)
    held = worlds.after(worlds.start, pick, pick.T_base_tool)
    assert held.held == "cup"
    np.testing.assert_allclose(held.T_tool_held[:3, 3], (0.0, 0.0, 0.02), atol=1e-12)
    brought = worlds.after(held, place, place.T_base_tool)
    assert brought.held is None
    np.testing.assert_allclose(dict(brought.moved)["cup"][:3, 3], (0.4, 0.2, 0.2), atol=1e-12)
    assert len({worlds.start.key, held.key, brought.key}) == 3


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


def test_nothing_is_sent_that_is_not_proved(robot: Robot, crs97: Unit) -> None:
    """The search proves lines first; the mover does not believe it."""
    post = Body("post", Cylinder(0.03, 0.5), transform(t=(0.42, 0.02, 0.2)), "post")
    world = World(robot, [TABLE, post])
    grid = _grid(robot, crs97)
    mover = PoseMover(robot, grid, crs97.limits(), crs97.limits(), FAST, [Target("a", down(0.42, 0.0, 0.3))])
    way = np.radians([[-35, -20, -100, 0, -60, 0], [35, -20, -100, 0, -60, 0], [35, -20, -90, 0, -60, 0]])
    piece = Piece("to a", "transit", world, 0.01, None, frozenset(), way=way)
    with pytest.raises(ImpossibleError, match=r"to a: .* comes to .* of post after"):
        mover.run([piece], [])
    clear = mover.run([replace(piece, world=World(robot, [TABLE]))], [])
    assert len(clear) == 1

    refused = _refused(
        robot, crs97, [TABLE, post],
        Target("a", down(0.42, -0.2, 0.2), free="rz"), Target("b", down(0.42, 0.2, 0.2), by="line", free="rz"),
    )  # fmt: skip
    assert "on the line at b" in str(refused)
    assert refused.data["pair"][1] == "post"


def test_where_the_tool_turns_back_there_is_no_corner_to_cut(robot: Robot, crs97: Unit) -> None:
    target = Target("a", down(0.45, -0.2, 0.1), free="rz", approach=0.03, retract=0.03, within=0.01)
    plan = plan_poses(
        robot,
        [TABLE],
        [target],
        np.radians([-35, -35, -85, 0, -60, 0]),
        crs97.limits(),
        options=FAST,
        effort=EFFORT,
    )
    check_plan(plan, [target], crs97.limits())
    tips = np.stack([robot.T_base_tool(q)[:3, 3] for q in plan.sample(0.01)[1]])
    assert np.linalg.norm(tips - target.T_base_tool[:3, 3], axis=1).min() < 2e-4
