"""Distances against MuJoCo's, and the properties that proofs rest on."""

from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np
import pinocchio as pin
import pytest

from arm.controller.unit import load_unit
from arm.errors import InputError
from arm.robot.model import Robot, load_a465
from arm.robot.shapes import Body, Box, Cylinder, Shape, Sphere
from arm.se3 import Array, apply, frozen, rotation, transform
from plan.budget import DISTANCE_CHECKS, SearchBudget, allowed
from plan.collision.bezier import curve_of_waypoints
from plan.collision.certificate import certify_curve
from plan.collision.covers import hull
from plan.collision.world import DISTANCE_ERROR, UNKNOWN_DEPTH, World, distance_of
from tasks.task2 import TABLE, TOOL_LENGTH, task2

HELD = Body("held", Box((0.04, 0.04, 0.04)), frozen(np.eye(4)), "cube")
T_TOOL_HELD = transform(t=(0.0, 0.0, 0.003))


def random_bodies(rng: np.random.Generator, count: int) -> list[Body]:
    """Boxes, cylinders and balls around the arm."""
    bodies = []
    for i in range(count):
        size = rng.uniform(0.03, 0.3, 3)
        shape: Shape = (
            Box((float(size[0]), float(size[1]), float(size[2])))
            if i % 3 == 0
            else Cylinder(float(size[0]) / 2, float(size[1]))
            if i % 3 == 1
            else Sphere(float(size[0]) / 2)
        )
        angle = rng.uniform(-np.pi, np.pi)
        place = np.array([0.7 * np.cos(angle), 0.7 * np.sin(angle), 0.3]) + rng.uniform(-0.2, 0.2, 3)
        bodies.append(Body(f"body {i}", shape, transform(rotation(rng.normal(size=3)), place), "wall"))
    return bodies


def random_q(robot: Robot, rng: np.random.Generator, count: int) -> Array:
    return rng.uniform(
        robot.model.lowerPositionLimit, robot.model.upperPositionLimit, (count, robot.model.nq)
    )


class Judge:
    """The same primitives in MuJoCo, each a free body that is put where Pinocchio says it is."""

    def __init__(self, shapes: dict[str, Shape]) -> None:
        spec = mujoco.MjSpec()
        for name, shape in shapes.items():
            holder = spec.worldbody.add_body(name=name, mocap=True)
            match shape:
                case Box(size):
                    holder.add_geom(name=name, type=mujoco.mjtGeom.mjGEOM_BOX, size=[s / 2 for s in size])
                case Cylinder(radius, length):
                    holder.add_geom(
                        name=name, type=mujoco.mjtGeom.mjGEOM_CYLINDER, size=[radius, length / 2, 0]
                    )
                case Sphere(radius):
                    holder.add_geom(name=name, type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[radius, 0, 0])
        spec.option.ccd_tolerance = 1e-9
        spec.option.ccd_iterations = 200
        self.model = spec.compile()
        self.data = mujoco.MjData(self.model)
        self.slot = {name: i for i, name in enumerate(shapes)}

    def place(self, bodies: list[Body]) -> None:
        for body in bodies:
            slot = self.slot[body.name]
            self.data.mocap_pos[slot] = body.T_base_body[:3, 3]
            matrix = np.ascontiguousarray(body.T_base_body[:3, :3]).ravel()
            mujoco.mju_mat2Quat(self.data.mocap_quat[slot], matrix)
        mujoco.mj_kinematics(self.model, self.data)

    def distance(self, pair: tuple[str, str]) -> float:
        a, b = (self.model.geom(name).id for name in pair)
        return float(mujoco.mj_geomDistance(self.model, self.data, a, b, 5.0, None))


def test_distances_are_mujocos_on_400_configurations() -> None:
    rng = np.random.default_rng(5)
    robot = load_a465(TOOL_LENGTH, 0.04)
    bodies = [TABLE, *random_bodies(rng, 8)]
    world = World(robot, bodies, HELD, T_TOOL_HELD)
    judge = Judge({b.name: b.shape for b in (*robot.bodies, HELD, *bodies)})
    every = np.arange(len(world.pairs))
    worst, overlapping, compared = 0.0, 0, 0
    for q in random_q(robot, rng, 400):
        held = HELD.at(robot.T_base_tool(q) @ T_TOOL_HELD)
        judge.place([*robot.bodies_at(q), held, *bodies])
        values = world.pair_distances(q, every)
        for i in every:
            theirs = judge.distance(world.pair_names(i))
            if values[i] > 0.0 or theirs > 0.0:  # depths of overlap are defined differently
                worst = max(worst, abs(values[i] - theirs))
                compared += 1
            else:
                overlapping += 1
    assert compared > 40_000
    assert overlapping > 120
    assert worst <= DISTANCE_ERROR


def test_in_collision_is_distance_below_clearance() -> None:
    rng = np.random.default_rng(6)
    robot = load_a465(TOOL_LENGTH, 0.06)
    world = World(robot, random_bodies(rng, 6), HELD, T_TOOL_HELD, padding=0.002)
    seen = set()
    for q in random_q(robot, rng, 400):
        closest = world.distance(q).value
        for clearance in (0.0, 0.01, 0.08):
            if abs(closest - clearance) > 1e-6:
                assert world.in_collision(q, clearance) == (closest < clearance)
                seen.add((clearance, closest < clearance))
    assert len(seen) == 6


def test_a_distance_does_not_depend_on_what_was_asked_before() -> None:
    rng = np.random.default_rng(10)
    robot = load_a465(TOOL_LENGTH, 0.06)
    world = World(robot, random_bodies(rng, 6))
    every = np.arange(len(world.pairs))
    qs = random_q(robot, rng, 50)
    forward = [world.pair_distances(q, every) for q in qs]
    backward = [world.pair_distances(q, every) for q in qs[::-1]][::-1]
    assert np.array_equal(forward, backward)


def test_witness_points_are_that_far_apart() -> None:
    rng = np.random.default_rng(7)
    robot = load_a465(TOOL_LENGTH, 0.06)
    world = World(robot, random_bodies(rng, 6))
    for q in random_q(robot, rng, 100):
        below = world.distances_below(q, 0.2)
        assert [d.value for d in below] == sorted(d.value for d in below)
        for d in below:
            if d.value > 1e-4:
                assert np.linalg.norm(d.points[0] - d.points[1]) == pytest.approx(d.value, abs=1e-5)


def surface(shape: Shape, rng: np.random.Generator, count: int) -> Array:
    """Random points of a body, many of them on its corners and rims."""
    match shape:
        case Box(size):
            return rng.choice([-1.0, 0.3, 1.0], (count, 3)) * np.array(size) / 2
        case Cylinder(radius, length):
            angle = rng.uniform(0, 2 * np.pi, count)
            z = rng.choice([-1.0, 1.0], count) * length / 2
            return np.column_stack([radius * np.cos(angle), radius * np.sin(angle), z])
        case Sphere(radius):
            v = rng.normal(size=(count, 3))
            return np.asarray(radius * v / np.linalg.norm(v, axis=1)[:, None])


def test_no_point_of_a_body_moves_further_than_the_bound() -> None:
    """The statement that `plan.collision.certificate` proves, for all bodies, small and large steps, whatever
    the way between."""
    rng = np.random.default_rng(8)
    robot = load_a465(TOOL_LENGTH, 0.06)
    moving = [b for b in robot.bodies if b.joint > 0]
    world = World(robot, [TABLE])
    tightest = 0.0
    for q in random_q(robot, rng, 300):
        delta = rng.uniform(0.0, rng.choice([0.01, 0.3, 2.0]), 6) * rng.integers(0, 2, 6)
        q_after = q + delta * rng.choice([-1.0, 1.0], 6)
        bounds = world.volumes.placed(np.atleast_2d(q)).radii[0] @ delta
        before, after = robot.joint_poses(q), robot.joint_poses(q_after)
        for body, bound in zip(moving, bounds, strict=True):
            points = apply(body.T_joint_body, surface(body.shape, rng, 20))
            way = np.linalg.norm(apply(after[body.joint], points) - apply(before[body.joint], points), axis=1)
            assert way.max() <= bound + 1e-12
            if bound > 0.0:
                tightest = max(tightest, way.max() / bound)
    assert tightest > 0.95  # the bound is not idle


def test_pair_distance_drops_by_no_more_than_the_pair_motion() -> None:
    rng = np.random.default_rng(9)
    robot = load_a465(TOOL_LENGTH, 0.06)
    world = World(robot, random_bodies(rng, 5), HELD, T_TOOL_HELD)
    every = np.arange(len(world.pairs))
    for q in random_q(robot, rng, 200):
        delta = rng.uniform(0.0, 0.2, 6)
        motion = world.volumes.motion_of(world.volumes.placed(q[None]), delta[None], 0 * every, every)
        before = world.pair_distances(q, every)
        after = world.pair_distances(q + delta * rng.uniform(-1.0, 1.0, 6), every)
        clear = (before > 0.0) & (after > 0.0)
        assert np.all((np.abs(before - after) <= motion + 2e-6)[clear])


def test_bodies_of_the_arm_move_only_with_the_joints_between_them() -> None:
    robot = load_a465(TOOL_LENGTH, 0.06)
    world = World(robot, [TABLE])
    first = np.array([1.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    every = np.arange(len(world.pairs))
    at = world.volumes.placed(np.full((1, 6), 0.3))
    motion = world.volumes.motion_of(at, first[None], 0 * every, every)
    for i in range(len(world.pairs)):
        names = world.pair_names(i)
        still = "table" in names or "base" in names
        assert (motion[i] > 0.0) == still, names


def test_what_is_checked() -> None:
    case = task2()
    robot = case.scene.robot_holding
    plain = World(robot, case.scene.bodies, HELD, T_TOOL_HELD)
    pairs = {frozenset(plain.pair_names(i)) for i in range(len(plain.pairs))}
    assert frozenset(("held", "table")) in pairs
    assert frozenset(("held", "forearm")) in pairs
    assert frozenset(("held", "finger_l")) not in pairs
    assert frozenset(("held", "palm")) not in pairs
    assert frozenset(("table", "plate 01-02")) not in pairs
    assert frozenset(("base", "table")) not in pairs
    assert not pairs & robot.disabled_collisions
    allowed = frozenset(("held", "plate 01-02"))
    fewer = World(robot, case.scene.bodies, HELD, T_TOOL_HELD, allowed=[allowed])
    assert pairs - {frozenset(fewer.pair_names(i)) for i in range(len(fewer.pairs))} == {allowed}


@pytest.mark.parametrize("unit", ["crs93", "crs97"])
def test_pairs_left_out_as_never_meeting_never_meet(unit: str) -> None:
    """Within the unit's limits; joint 5 at its ends is where hub and forearm are nearest."""
    rng = np.random.default_rng(3)
    robot, limits = load_a465(TOOL_LENGTH, 0.06), load_unit(unit).limits()
    world = World(replace(robot, disabled_collisions=frozenset()), [])
    never = [("base", "shoulder"), ("wrist", "gripper"), ("wrist", "palm"), ("forearm", "hub")]
    assert {frozenset(pair) for pair in never} <= robot.disabled_collisions
    pairs = np.array(
        [i for i in range(len(world.pairs)) if set(world.pair_names(i)) in [set(pair) for pair in never]]
    )
    assert len(pairs) == len(never)
    for k in range(600):
        q = rng.uniform(limits.lower, limits.upper)
        q[4] = (limits.lower[4], limits.upper[4], q[4])[k % 3]
        assert world.pair_distances(q, pairs).min() > 0.0


def test_padding_is_taken_off() -> None:
    robot = load_a465(TOOL_LENGTH, 0.06)
    q = np.radians([-60.0, -40.0, -80.0, 0.0, -60.0, 0.0])
    assert World(robot, [TABLE], padding=0.003).distance(q).value == pytest.approx(
        World(robot, [TABLE]).distance(q).value - 0.003, abs=1e-12
    )


def test_wrong_worlds_are_refused() -> None:
    robot = load_a465(TOOL_LENGTH, 0.06)
    with pytest.raises(InputError, match="T_tool_held must be given"):
        World(robot, [TABLE], HELD)
    with pytest.raises(InputError, match="bodies: names must differ"):
        World(robot, [TABLE, TABLE])


def test_an_overlap_of_unknown_depth_is_an_overlap() -> None:
    """A configuration (found by search) where coal gives no depth for a finger inside the forearm."""
    q = [2.560516793755516, -0.05584495188941768, -0.4457272443340115, -1.72358221036675]
    q += [2.8325792858043037, 0.8915420478808606]
    world = World(load_a465(TOOL_LENGTH, 0.04), [TABLE])
    assert world.distance(q).value == UNKNOWN_DEPTH
    assert world.distance(q).pair == ("finger_l", "forearm")
    assert world.in_collision(q)


def _padded(body: Body, padding: float) -> Body:
    return replace(body, padding=padding)


def test_paddings_of_bodies_are_taken_off_their_own_distances_only() -> None:
    """Of arm, of a held body and of what stands still: in every way of asking, and in the proof."""
    rng = np.random.default_rng(31)
    bodies = random_bodies(rng, 6)
    padding = {b.name: float(rng.uniform(0.0, 0.02)) for b in bodies} | {HELD.name: 0.004, "forearm": 0.01}
    robot = load_a465(0.134112, 0.04)
    padded = replace(robot, bodies=tuple(replace(b, padding=padding.get(b.name, 0.0)) for b in robot.bodies))
    bare = World(robot, bodies, HELD, T_TOOL_HELD)
    world = World(
        padded,
        [_padded(b, padding[b.name]) for b in bodies],
        _padded(HELD, 0.004),
        T_TOOL_HELD,
        padding=0.001,
    )
    every = np.arange(len(bare.pairs))
    for q in rng.uniform(-1.5, 1.5, (20, 6)):
        off = np.array([0.001 + sum(padding.get(n, 0.0) for n in bare.pair_names(i)) for i in every])
        wanted = bare.pair_distances(q, every) - off
        assert np.abs(world.pair_distances(q, every) - wanted).max() < 1e-12
        zeros = np.zeros_like(every)
        assert np.abs(world.witnesses(q[None], zeros, every).distance - wanted).max() < 1e-12
        near = world.near(q[None], 0.05)
        assert set(near.pair.tolist()) == set(np.flatnonzero(wanted < 0.05).tolist())
        for clearance in (0.0, 0.01, float(wanted.min()) - 1e-5, float(wanted.min()) + 1e-5):
            assert world.in_collision(q, clearance) == bool(wanted.min() < clearance)


def test_a_proof_takes_the_paddings_off() -> None:
    q = np.radians([10.0, -40.0, -80.0, 0.0, -60.0, 0.0])
    robot, curve = load_a465(0.134112, 0.06), curve_of_waypoints(np.stack([q, q + 0.05]))
    tool = robot.T_base_tool(q)[:3, 3]
    low = Body("low", Box((0.2, 0.2, 0.02)), transform(t=(tool[0], tool[1], tool[2] - 0.06)), "wall")
    bare = certify_curve(World(robot, [low]), curve, 0.0, tight=True)
    padded = certify_curve(World(robot, [_padded(low, 0.03)]), curve, 0.0, tight=True)
    asked = bare.seen - 0.02
    assert bare.pair[1] == "low"
    assert 0.0 < padded.clearance <= bare.seen - 0.03
    assert certify_curve(World(robot, [low]), curve, asked).proved
    assert not certify_curve(World(robot, [_padded(low, 0.03)]), curve, asked).proved


def test_what_is_no_configuration_and_no_pose_is_refused() -> None:
    robot = load_a465(TOOL_LENGTH, 0.06)
    world = World(robot, [TABLE])
    for wrong in (np.zeros(6), np.zeros((2, 5)), np.zeros((1, 2, 6)), np.full((2, 6), np.nan)):
        with pytest.raises(InputError, match=r"must be \(m, 6\) finite numbers, rad"):
            world.near(wrong, 0.1)
    with pytest.raises(InputError, match=r"robot\.T_end_tool"):
        World(replace(robot, T_end_tool=frozen(2.0 * np.eye(4))), [TABLE])


def test_a_contact_allowed_with_a_body_that_is_not_there_takes_nothing_away() -> None:
    robot, rng = load_a465(TOOL_LENGTH, 0.06), np.random.default_rng(8)
    bodies = random_bodies(rng, 4)
    every = World(robot, bodies)
    absent = [frozenset(("no such body", name)) for name in every.names]
    assert World(robot, bodies, allowed=absent).pairs.tolist() == every.pairs.tolist()


def test_the_distance_of_two_bodies_where_they_are_is_that_of_their_nearest_points() -> None:
    rng = np.random.default_rng(9)
    for gap in (0.2, 1e-3, -0.01):
        turn = transform(rotation(rng.normal(size=3)), rng.uniform(-0.5, 0.5, 3))
        box = Body("box", Box((0.2, 0.1, 0.3)), frozen(turn), "wall")
        ball = Body("ball", Sphere(0.05), frozen(turn @ transform(t=(0.02, 0.05 + 0.05 + gap, -0.1))), "wall")
        for first, second in ((box, ball), (ball, box)):
            found = distance_of(first, second)
            assert found.value == pytest.approx(gap, abs=DISTANCE_ERROR)
            assert found.pair == (first.name, second.name)
            if gap > 0.0:
                assert np.linalg.norm(found.points[0] - found.points[1]) == pytest.approx(gap, abs=1e-5)


def test_a_radius_is_the_largest_distance_of_a_body_from_the_axis() -> None:
    """Not only no less: what it is larger by is taken off every proof."""
    robot, rng = load_a465(TOOL_LENGTH, 0.06), np.random.default_rng(10)
    world = World(robot, [TABLE])
    data = robot.model.createData()
    for q in random_q(robot, rng, 20):
        pin.forwardKinematics(robot.model, data, q)
        radii = world.volumes.placed(np.atleast_2d(q)).radii[0]
        for row, body in zip(radii, (b for b in robot.bodies if b.joint > 0), strict=True):
            corners, ball = hull(body.shape)
            T = data.oMi[body.joint].homogeneous @ body.T_joint_body
            points = apply(T, corners)
            for k in range(6):
                pose = data.oMi[k + 1]
                axis = pose.rotation[:, 2]
                away = np.linalg.norm(np.cross(points - pose.translation, axis), axis=1).max() + ball
                assert row[k] == pytest.approx(away if k < body.joint else 0.0, abs=1e-6)


def test_distances_cost_effort_by_their_number() -> None:
    world = World(load_a465(TOOL_LENGTH, 0.06), [TABLE])
    costs = []
    for count in (1, 2, 8):
        with allowed(SearchBudget(1e3)) as meter:
            world.pair_distances(np.zeros(6), np.arange(count))
        costs.append(meter.checks)
    assert costs == pytest.approx([DISTANCE_CHECKS, 2 * DISTANCE_CHECKS, 8 * DISTANCE_CHECKS])


def test_near_pairs_have_a_limit_each() -> None:
    rng = np.random.default_rng(12)
    world = World(load_a465(TOOL_LENGTH, 0.06), [TABLE, *random_bodies(rng, 4)])
    named = world.pairs_of(["table"])
    assert named.tolist() == ["table" in world.pair_names(i) for i in range(len(world.pairs))]
    limits = np.where(named, 0.3, rng.uniform(-0.1, 0.2, len(world.pairs)))
    q = rng.uniform(-1.5, 1.5, (10, 6))
    found, every = world.near(q, limits), world.near(q, 0.3)
    some = every.distance < limits[every.pair]
    assert 0 < some.sum() < len(some)
    for key in ("row", "pair", "distance", "gradient"):
        np.testing.assert_array_equal(getattr(found, key), getattr(every.chosen(some), key))


def test_the_state_of_a_world_says_where_movable_bodies_are(robot: Robot) -> None:
    bodies, q = random_bodies(np.random.default_rng(5), 6), np.full(robot.model.nq, 0.4)
    cubes = [replace(b, name=f"cube {b.name}", kind="cube") for b in bodies[:2]]
    world = World(robot, [*bodies[2:], *cubes], HELD, T_TOOL_HELD)
    at = world.state(q)["at"]
    moved = [cube.at(np.array(at["moved"].pop(cube.name))) for cube in cubes]
    again, every = World(robot, [*bodies[2:], *moved], HELD, at["T_tool_held"]), np.arange(len(world.pairs))
    assert again.pair_distances(at["q"], every) == pytest.approx(world.pair_distances(q, every), abs=1e-9)
