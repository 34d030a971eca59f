"""Threads: what links a ring with a wire and its ray, and that no motion over the free end is accepted."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from arm.controller.unit import Unit, load_unit
from arm.errors import ImpossibleError, InputError
from arm.numerics.products import mul
from arm.plan_file import Move, Plan, read_plan, write_plan
from arm.robot.model import Robot, load_a465
from arm.robot.shapes import Body, Capsule, Torus
from arm.robot.thread import Thread, thread_from_json
from arm.robot.tool import with_tool
from arm.se3 import Array, apply, inverse, rot_z, transform
from plan.collision.bezier import curve_of_waypoints
from plan.collision.certificate import certify_curve
from plan.collision.world import World
from plan.kinematics.ik import inverse_kinematics
from plan.options import PlanOptions
from plan.program.goals.target import Target
from plan.program.planned import Planned
from plan.program.program import Program, plan_program
from plan.scene import Scene, scene_from_json
from plan.verify import replay

FOOT, TIP = np.array([0.45, 0.0, 0.05]), np.array([0.45, 0.0, 0.25])
THREAD = Thread("wire", "ring", np.stack([FOOT, TIP]))
BAR = Body("bar", Capsule(0.005, 0.2), transform(t=(FOOT + TIP) / 2.0), "wire")
RADIUS = 0.03
TURN = np.array([0.3, 0.0, 0.0, 0.0, 0.0, 0.0])


@pytest.fixture(scope="module")
def unit() -> Unit:
    return load_unit("crs93")


@pytest.fixture(scope="module")
def hoop() -> Robot:
    """The arm with a ring beside its flange, level if the gripper points down."""
    robot = load_a465(tool_length=0.134112, jaw_opening=0.06)
    T = transform(np.diag([-1.0, 1.0, -1.0]), (-0.135, 0.0, 0.013))
    return with_tool(robot, T, [Body("ring", Torus(RADIUS, 0.003), T, "robot")])


def at(hoop: Robot, unit: Unit, T_base_ring: Array) -> Array:
    limits = unit.limits()
    return inverse_kinematics(hoop, T_base_ring, limits.lower, limits.upper).q[0]


def ring_at(height: float, aside: float = 0.0) -> Array:
    """The ring level about the wire's axis, its handle away from the wire."""
    return transform(rot_z(np.pi / 2.0), TIP + (aside, 0.0, height))


@pytest.mark.parametrize(
    ("height", "aside", "number"), [(-0.1, 0.0, 1), (0.05, 0.0, 1), (0.05, 0.1, 0), (-0.1, 0.04, 0)]
)
def test_linking_counts_wire_and_ray(
    hoop: Robot, unit: Unit, height: float, aside: float, number: int
) -> None:
    """The ring is linked with wire and ray wherever it surrounds their line, above the free end too."""
    q = at(hoop, unit, ring_at(height, aside))
    assert abs(THREAD.linking_number(hoop, q)) == number


def test_a_line_through_the_ring_and_back_does_not_link(hoop: Robot, unit: Unit) -> None:
    q = at(hoop, unit, ring_at(-0.1))
    loop = np.array(
        [[0.45, 0.0, 0.05], [0.45, 0.0, 0.2], [0.46, 0.0, 0.2], [0.46, 0.0, 0.05], [0.6, 0.0, 0.05]]
    )
    assert Thread("loop", "ring", loop).linking_number(hoop, q) == 0


def test_linking_does_not_depend_on_the_frame(hoop: Robot, unit: Unit) -> None:
    """Turning the arm about its first axis turns ring and wire alike."""
    q = at(hoop, unit, ring_at(-0.1))
    T = mul(hoop.T_base_tool(q + TURN), inverse(hoop.T_base_tool(q)))
    turned = Thread("wire", "ring", apply(T, THREAD.line))
    assert turned.linking_number(hoop, q + TURN) == THREAD.linking_number(hoop, q)


def test_the_rays_go_on_where_the_wire_ends() -> None:
    ray, behind = THREAD.rays
    low = apply(ray.T_base_body, (0.0, 0.0, -ray.shape.length / 2.0))
    assert low == pytest.approx(TIP, abs=1e-12)
    assert apply(ray.T_base_body, (0.0, 0.0, 1.0))[2] > TIP[2]
    top = apply(behind.T_base_body, (0.0, 0.0, -behind.shape.length / 2.0))
    assert top == pytest.approx(FOOT, abs=1e-12)
    assert apply(behind.T_base_body, (0.0, 0.0, 1.0))[2] < FOOT[2]
    names = "beyond wire", "beyond the foot of wire"
    assert THREAD.exempt(["ring", "palm"]) == {frozenset((name, "palm")) for name in names}


def test_json_and_what_is_refused(hoop: Robot, unit: Unit) -> None:
    again = thread_from_json(THREAD.to_json())
    assert (again.name, again.ring) == ("wire", "ring")
    assert np.array_equal(again.line, THREAD.line)
    for wrong in ({}, {"name": "wire", "ring": 3}, {"name": "wire", "ring": "ring", "line": [[0, 0, 0]]}, []):
        with pytest.raises(InputError):
            thread_from_json(wrong)
    for line in ("x", [[0, 0, 0], [1]], [[0, 0, 0], [1, 1, "a"]]):
        with pytest.raises(InputError, match="must be points"):
            thread_from_json({**THREAD.to_json(), "line": line})
    with pytest.raises(InputError, match="whose shape is a torus"):
        Thread("wire", "palm", THREAD.line).linking_number(hoop, np.zeros(6))
    with pytest.raises(InputError, match="the first two different, and the last two"):
        Thread("wire", "ring", np.stack([TIP, TIP]))
    with pytest.raises(InputError, match="the first two different, and the last two"):
        Thread("wire", "ring", np.stack([FOOT, FOOT, TIP]))


def world(hoop: Robot) -> World:
    names = [body.name for body in hoop.bodies]
    return World(hoop, [BAR, *THREAD.rays], allowed=THREAD.exempt(names))


def test_no_motion_over_the_free_end_keeps_its_distance_from_wire_and_ray(hoop: Robot, unit: Unit) -> None:
    """Random ways from threaded to unthreaded: whatever leads off the wire is refuted."""
    rng, checked = np.random.default_rng(3), 0
    seen = world(hoop)
    for _ in range(40):
        heights = -0.12 * rng.random(), 0.02 + 0.05 * rng.random()
        aside = (0.06 + 0.05 * rng.random()) * rng.choice((-1.0, 1.0))
        waypoints = [
            at(hoop, unit, ring_at(height, away))
            for height, away in ((heights[0], 0.0), (heights[1], 0.0), (heights[1], aside))
        ]
        if np.abs(np.diff(waypoints, axis=0)).max() > 1.0:
            continue  # another branch
        checked += 1
        first, last = waypoints[0], waypoints[-1]
        assert abs(THREAD.linking_number(hoop, first)) == 1
        assert THREAD.linking_number(hoop, last) == 0
        assert not certify_curve(seen, curve_of_waypoints(np.array(waypoints)), 1e-3).proved
    assert checked > 20


def test_no_motion_under_the_foot_keeps_its_distance_from_the_rays(hoop: Robot, unit: Unit) -> None:
    """A wire may stand on nothing that keeps the ring above its foot."""
    high = FOOT + (0.0, 0.0, 0.25), TIP + (0.0, 0.0, 0.25)
    lifted = Thread("wire", "ring", np.stack(high))
    bar = BAR.at(transform(t=(high[0] + high[1]) / 2.0))
    waypoints = np.array([at(hoop, unit, ring_at(height)) for height in (0.2, 0.0)])
    assert [abs(lifted.linking_number(hoop, q)) for q in waypoints] == [1, 1]
    aside = at(hoop, unit, ring_at(0.0, 0.1))
    assert np.abs(aside - waypoints[-1]).max() < 1.0  # of the same branch
    way = curve_of_waypoints(np.array([*waypoints, aside]))
    allowed = lifted.exempt([body.name for body in hoop.bodies])
    only = World(hoop, [bar], allowed=allowed).only(["ring"])
    assert certify_curve(only, way, 1e-3).proved
    assert lifted.linking_number(hoop, aside) == 0
    found = certify_curve(World(hoop, [bar, *lifted.rays], allowed=allowed).only(["ring"]), way, 1e-3)
    assert not found.proved
    assert "beyond the foot of wire" in found.pair


@pytest.fixture(scope="module")
def threaded(hoop: Robot, unit: Unit) -> Planned:
    """A plan down the wire and back."""
    poses = np.stack([ring_at(height) for height in np.linspace(0.05, -0.12, 12)])
    goal = Target(
        "wire", poses, by="path", free="rz", tilt=0.3, back=True, line_clearance=0.003, threaded="wire"
    )
    scene = Scene(hoop, hoop, (BAR,), (), threads=(THREAD,))
    q_start = at(hoop, unit, ring_at(0.1, 0.1))
    options = PlanOptions(clearance=0.005)
    return plan_program(
        Program(scene, (goal, Target("home", q=q_start)), q_start, unit, unit.limits(), options)
    )


def test_a_threaded_path_says_so_and_is_verified(
    threaded: Planned, hoop: Robot, unit: Unit, tmp_path: Path
) -> None:
    write_plan(tmp_path / "plan.json", threaded.plan())
    plan = read_plan(tmp_path / "plan.json")
    moves = list(plan.moves)
    assert [move.threaded for move in moves] == [None, "wire", "wire", None]
    scene = scene_from_json(plan.scene, hoop, hoop)
    assert len(replay(plan, scene, unit, unit.limits())) == 4
    sampled = unit.positions(moves[1].path.sample(0.02))
    assert {abs(THREAD.linking_number(hoop, q)) for q in sampled} == {1}


def planned(hoop: Robot, unit: Unit, goal: Target) -> Planned:
    scene = Scene(hoop, hoop, (BAR,), (), threads=(THREAD,))
    return plan_program(Program(scene, (goal,), at(hoop, unit, goal.curve.T_start), unit, unit.limits()))


def called_threaded(plan: Plan, *names: str) -> Plan:
    """The same plan, which says of some of its moves, or of all, that the ring stays on the wire."""
    steps = tuple(
        replace(s, threaded="wire") if isinstance(s, Move) and (s.name in names or not names) else s
        for s in plan.steps
    )
    return replace(plan, steps=steps)


@pytest.mark.slow
def test_a_path_over_the_free_end_is_refused_if_it_should_stay(hoop: Robot, unit: Unit) -> None:
    """Planning and verification see the ray; the same path without a thread is fine."""
    round = [
        (0.06 - 0.03 * (1.0 - np.sin(u)), 0.03 * (1.0 - np.cos(u))) for u in np.linspace(0.0, np.pi / 2.0, 30)
    ]
    over = [ring_at(*place) for place in [(-0.05, 0.0), *round, (0.06, 0.1)]]
    goal = Target("over", np.stack(over), by="path", free="rz", line_clearance=0.003)
    with pytest.raises(ImpossibleError):
        planned(hoop, unit, replace(goal, threaded="wire"))
    plan = planned(hoop, unit, goal).plan()
    scene = scene_from_json(plan.scene, hoop, hoop)
    replay(plan, scene, unit, unit.limits())
    with pytest.raises(ImpossibleError, match="of beyond wire"):
        replay(called_threaded(plan), scene, unit, unit.limits())


@pytest.mark.slow
def test_a_path_under_the_foot_is_refused_if_it_should_stay(hoop: Robot, unit: Unit) -> None:
    """The wire stands on nothing: the ring could leave it there as well, and the line of wire and rays knows."""
    lifted = Thread("wire", "ring", THREAD.line + (0.0, 0.0, 0.25))
    scene = Scene(hoop, hoop, (BAR.at(transform(t=lifted.line.mean(axis=0))),), (), threads=(lifted,))
    bend = [(-0.02 - 0.03 * np.sin(u), 0.03 * (1.0 - np.cos(u))) for u in np.linspace(0.0, np.pi / 2.0, 30)]
    under = [ring_at(*place) for place in [(0.15, 0.0), *bend, (-0.05, 0.1)]]
    goal = Target("under", np.stack(under), by="path", free="rz", line_clearance=0.003)
    q_start = at(hoop, unit, goal.curve.T_start)
    plan = plan_program(Program(scene, (goal,), q_start, unit, unit.limits())).plan()
    now = scene_from_json(plan.scene, hoop, hoop)
    replay(plan, now, unit, unit.limits())
    with pytest.raises(ImpossibleError, match="beyond the foot of wire"):
        replay(called_threaded(plan, "along under"), now, unit, unit.limits())
    with pytest.raises(ImpossibleError, match="beyond the foot of wire"):
        plan_program(Program(scene, (replace(goal, threaded="wire"),), q_start, unit, unit.limits()))


def test_a_move_beside_the_wire_that_is_called_threaded_is_refused(hoop: Robot, unit: Unit) -> None:
    poses = np.stack([ring_at(height, 0.1) for height in (0.05, 0.0)])
    plan = planned(hoop, unit, Target("beside", poses, by="path", free="rz")).plan()
    with pytest.raises(ImpossibleError, match="not threaded on wire"):
        replay(called_threaded(plan), scene_from_json(plan.scene, hoop, hoop), unit, unit.limits())


def test_a_path_beside_the_wire_is_refused(hoop: Robot, unit: Unit) -> None:
    poses = np.stack([ring_at(height, 0.1) for height in (0.05, 0.0)])
    goal = Target("beside", poses, by="path", free="rz", threaded="wire")
    scene = Scene(hoop, hoop, (BAR,), (), threads=(THREAD,))
    q = at(hoop, unit, ring_at(0.05, 0.1))
    with pytest.raises(ImpossibleError, match="ring not threaded on wire: linking number 0"):
        plan_program(Program(scene, (goal,), q, unit, unit.limits()))
    unknown = replace(goal, threaded="rope")
    with pytest.raises(InputError, match="rope"):
        plan_program(Program(scene, (unknown,), q, unit, unit.limits()))


def test_only_paths_are_threaded() -> None:
    with pytest.raises(InputError, match="needs by='path'"):
        Target("pose", ring_at(0.0), threaded="wire")
