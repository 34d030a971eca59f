"""Motions that graze: random arms, motions and bodies, put so that the closest approach is near what is asked."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np

from arm.controller.segments import CountPath, Segment
from arm.controller.unit import load_unit
from arm.robot.model import LinkBody, Robot, load_a465, load_robot
from arm.robot.shapes import Body, Box, Capsule, Cylinder, Shape, Sphere, Torus, convex
from arm.se3 import Array, frozen, rotation, transform
from plan.collision.bezier import Curve, curve_of_counts, curve_of_waypoints
from plan.collision.world import World
from tasks.task2 import TABLE, TOOL_LENGTH

UNIT = load_unit("crs93")
MOTIONS = ("straight", "cubic", "counts", "run", "to and fro")
OBSTACLES = ("box", "sheet", "plane", "cylinder", "capsule", "ball", "mesh", "torus", "self")
ARMS = ("open", "holding", "seven joints")
HULLS = "hulls"  # the seven joints, each body the hull of 200 points
CLEARANCES = (0.0, 0.005, 0.01, 0.01, 0.03)
NEAR = (-0.002, 0.005)  # of the closest approach from what is asked, m
_FAR = 0.15  # m
_HELD = Body("held", Box((0.04, 0.04, 0.04)), frozen(np.eye(4)), "cube")
_MADE_UP = (  # seven joints, the third and the sixth slide
    ("0 0 0.2", "0 0 1", "revolute"),
    ("0 0.05 0.1", "0 1 0", "revolute"),
    ("0 0 0.15", "1 0 0.2", "prismatic"),
    ("0.05 0 0.2", "0 1 0", "revolute"),
    ("0 0 0.15", "0 0.6 0.8", "revolute"),
    ("0 0 0.1", "0 0 1", "prismatic"),
    ("0.03 0 0.1", "0 1 0", "revolute"),
)


@dataclass(frozen=True)
class Case:
    """One motion in one world.

    Attributes:
        kind: arm, motion and body, for people.
        world: with the body in it.
        curve: the motion.
        clearance: asked for, m.
    """

    kind: tuple[str, str, str]
    world: World
    curve: Curve
    clearance: float


def draw(seed: int) -> Case:
    """The case of a seed."""
    rng = np.random.default_rng([seed, 4])
    kind = (
        ARMS[int(rng.integers(len(ARMS)))],
        MOTIONS[int(rng.integers(len(MOTIONS)))],
        OBSTACLES[int(rng.integers(len(OBSTACLES)))],
    )
    if kind[0] == "seven joints" and kind[1] == "counts":
        kind = (kind[0], "cubic", kind[2])  # counts are those of the A465's encoders
    clearance = float(rng.choice(CLEARANCES))
    wanted = clearance + float(rng.uniform(*NEAR))
    padding = float(rng.choice([0.0, 0.0, 0.002]))
    others = [TABLE] if kind[0] != "seven joints" and rng.random() < 0.5 else []
    curve = _clear_motion(kind, world_of(kind[0], others, padding), clearance + NEAR[1], rng)
    if kind[2] == "self":
        # the bodies cannot be put anywhere: what is asked is put near to what there is
        world = world_of(kind[0], [])
        clearance = max(0.0, least(world, samples(curve, 40)) - float(rng.uniform(*NEAR)))
        return Case(kind, world, curve, clearance)
    body = beside(kind[0], curve, obstacle(kind[2], rng), wanted + padding, rng)
    return Case(kind, world_of(kind[0], [body, *others], padding), curve, clearance)


def _clear_motion(
    kind: tuple[str, str, str], world: World, clearance: float, rng: np.random.Generator
) -> Curve:
    """A motion that, as far as a few samples tell, is clear of all but the body that is still to be put there."""
    model = world.robot.model
    lower, upper = np.asarray(model.lowerPositionLimit), np.asarray(model.upperPositionLimit)
    for _ in range(30):
        curve = motion(kind[1], lower, upper, rng)
        if least(world, samples(curve, 20)) > clearance:
            break
    return curve


def world_of(name: str, bodies: Sequence[Body], padding: float = 0.0) -> World:
    """An arm among bodies; the one that is holding has a cube in its jaws."""
    if name == "holding":
        return World(arm(name), bodies, _HELD, transform(t=(0.0, 0.0, 0.003)), padding=padding)
    return World(arm(name), bodies, padding=padding)


@cache
def arm(name: str) -> Robot:
    """One of `ARMS`, or `HULLS`."""
    if name == HULLS:
        bare, rng = arm("seven joints"), np.random.default_rng(1)
        tubes = [rng.normal(size=(200, 3)) for _ in bare.bodies]
        skins = [
            convex(tube / np.linalg.norm(tube, axis=1)[:, None] * size)
            for tube, size in zip(tubes, rng.uniform(0.03, 0.12, (len(tubes), 3)), strict=True)
        ]
        pairs = zip(bare.bodies, skins, strict=True)
        return replace(bare, bodies=tuple(replace(body, shape=skin) for body, skin in pairs))
    if name != "seven joints":
        return load_a465(TOOL_LENGTH, 0.04 if name == "holding" else 0.06)
    links = "".join(f'<link name="l{k}"/>' for k in range(len(_MADE_UP) + 1))
    joints = "".join(
        f'<joint name="q{k + 1}" type="{kind}"><parent link="l{k}"/><child link="l{k + 1}"/><origin xyz="{xyz}"/>'
        f'<axis xyz="{axis}"/><limit lower="{-0.2 if kind == "prismatic" else -2.5}" '
        f'upper="{0.2 if kind == "prismatic" else 2.5}" velocity="1" effort="1"/></joint>'
        for k, (xyz, axis, kind) in enumerate(_MADE_UP)
    )
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "arm.urdf"
        path.write_text(f'<robot name="made_up">{links}{joints}</robot>')
        robot = load_robot(path, f"l{len(_MADE_UP)}", transform(t=(0.02, 0.0, 0.07)))
    rng = np.random.default_rng(0)
    shapes: list[Shape] = [
        Cylinder(0.08, 0.12),
        Capsule(0.05, 0.12),
        convex(rng.uniform(-0.06, 0.06, (20, 3))),
        Box((0.08, 0.06, 0.16)),
        Capsule(0.04, 0.08),
        Sphere(0.04),
        convex(rng.uniform(-0.03, 0.03, (12, 3)) + (0.0, 0.0, 0.05)),
    ]
    bodies = tuple(
        LinkBody(f"b{k + 1}", k + 1, shape, transform(rotation(rng.normal(size=3) * 0.3), (0.0, 0.0, 0.03)))
        for k, shape in enumerate(shapes)
    )
    foot = LinkBody("b0", 0, Box((0.2, 0.2, 0.1)), transform(t=(0.0, 0.0, 0.0)))
    touching = frozenset(frozenset((f"b{k}", f"b{k + 1}")) for k in range(len(bodies)))
    return replace(robot, bodies=(foot, *bodies), disabled_collisions=touching)


def motion(kind: str, lower: Array, upper: Array, rng: np.random.Generator) -> Curve:
    """A random motion about a random configuration, from hardly moving to a radian per joint."""
    n = len(lower)
    size = float(rng.choice([0.02, 0.1, 0.3, 0.8])) * rng.integers(0, 2, n).astype(float)
    size[int(rng.integers(n))] = 0.3  # some joint moves
    q = rng.uniform(lower, upper)
    if kind == "straight":
        count = int(rng.integers(2, 4))
        return curve_of_waypoints(q + size * rng.uniform(-1.0, 1.0, (count, n)))
    if kind == "cubic":
        return Curve(q + size * rng.normal(size=(1, 4, n)) * 0.6, np.array([1.0]))
    if kind == "counts":
        return curve_of_counts(count_path(q, size, rng), UNIT)
    if kind == "to and fro":
        return to_and_fro(q, size, rng)
    return run(q, size, rng)


def count_path(q: Array, size: Array, rng: np.random.Generator) -> CountPath:
    """Integer segments of order 1 to 3, one after the other."""
    segments = []
    for _ in range(int(rng.integers(1, 6))):
        scale = np.abs(UNIT.counts_per_rad) * size * 0.5
        rows = [
            tuple(int(v) for v in np.rint(rng.normal(size=6) * scale)) for _ in range(int(rng.integers(1, 4)))
        ]
        segments.append(Segment(int(rng.integers(40, 400)), tuple(rows)))
    return CountPath(tuple(int(c) for c in UNIT.counts(q)), tuple(segments))


def run(q: Array, size: Array, rng: np.random.Generator) -> Curve:
    """A straight way from rest to rest cut into many cubics, which stray a little from it, as rounded motions do."""
    count = int(rng.integers(5, 30))
    way = size * rng.uniform(-1.0, 1.0, len(q))
    u = np.linspace(0.0, 1.0, 3 * count + 1)
    points = q + (u * u * (3.0 - 2.0 * u))[:, None] * way
    points += rng.choice([0.0, 1e-5, 1e-3]) * rng.normal(size=points.shape)
    control = np.stack([points[3 * i : 3 * i + 4] for i in range(count)])
    return Curve(control, np.arange(1.0, count + 1.0))


def to_and_fro(q: Array, size: Array, rng: np.random.Generator) -> Curve:
    """One to three cubics that go out and come back: what is nearest is between their ends, and their middles.

    Each goes out on one side (a bow) or on both (an S), or passes and turns back twice on its way; all joints in step.
    """
    cubics = []
    for _ in range(int(rng.integers(1, 4))):
        out = size * rng.uniform(-1.0, 1.0, len(q))
        if rng.random() < 0.3:
            middle, turn = rng.uniform(0.2, 0.8), rng.uniform(0.03, 0.3)
            u = np.array([0.0, 1.0]) - middle
            (begin, end), (leaving, coming) = u**3 - 3.0 * turn**2 * u, u**2 - turn**2
            shape = np.array([begin, begin + leaving, end - coming, end]) - begin
        else:
            shape = np.array([0.0, 1.0, rng.uniform(0.5, 1.0) * rng.choice([-1.0, -1.0, 1.0]), 0.0])
        cubics.append(q + (shape / np.abs(shape).max())[:, None] * out)
        q = cubics[-1][3]
    return Curve(np.stack(cubics), np.arange(1.0, len(cubics) + 1.0))


def obstacle(kind: str, rng: np.random.Generator) -> Shape:
    """A random body of a kind of `OBSTACLES`."""
    a, b, c = (float(v) for v in rng.uniform(0.02, 0.3, 3))
    match kind:
        case "box":
            return Box((a, b, c))
        case "sheet":
            return Box((3.0 * a, 3.0 * b, float(rng.choice([1e-4, 1e-3, 3e-3]))))
        case "plane":
            side = float(rng.choice([2.0, 6.0, 20.0]))
            return Box((side, side, 0.04))
        case "cylinder":
            return Cylinder(a / 2.0, 2.0 * b)
        case "capsule":
            return Capsule(a / 4.0, 2.0 * b)
        case "ball":
            return Sphere(a / 2.0)
        case "torus":
            return Torus(a / 2.0, b / 10.0)
    return convex(rng.uniform(-0.5, 0.5, (int(rng.integers(6, 30)), 3)) * (a, b, c))


def beside(name: str, curve: Curve, shape: Shape, wanted: float, rng: np.random.Generator) -> Body:
    """The body at a pose where the arm's closest approach to it is about `wanted` m; not always found."""
    q = samples(curve, 24)
    robot = arm(name)
    moving = [b for b in robot.bodies if b.joint > 0]
    part = moving[int(rng.integers(len(moving) // 3, len(moving)))]
    at = robot.joint_poses(q[int(rng.integers(len(q)))])[part.joint] @ part.T_joint_body
    direction = rng.normal(size=3)
    direction /= np.linalg.norm(direction)
    turn = rotation(rng.normal(size=3)) if rng.random() < 0.8 else np.eye(3)
    body = Body("body", shape, transform(turn, at[:3, 3] + (0.1 + _radius(shape)) * direction), "wall")
    for count in (24, 24, 24, 24, 80, 80):
        world = world_of(name, [body])
        # only what concerns the body: other pairs are as near as they are
        mine = np.flatnonzero((world.pairs == world.names.index("body")).any(axis=1))
        at = samples(curve, count)
        rows, pairs = (x.ravel() for x in np.indices((len(at), len(mine))))
        found = world.witnesses(at, rows, mine[pairs])
        values = found.distance.reshape(len(at), -1)
        row, pair = np.unravel_index(int(np.argmin(values)), values.shape)
        short = wanted - float(values[row, pair])
        normal = found.normal[int(row) * len(mine) + int(pair)]
        if abs(short) < 1e-4 or not np.isfinite(normal).all():
            break
        # the still body comes first in a pair, so that its normal points to the arm
        body = body.at(transform(turn, body.T_base_body[:3, 3] - short * normal))
    return body


def _radius(shape: Shape) -> float:
    match shape:
        case Box(size):
            return min(size) / 2.0
        case Cylinder(radius, _) | Capsule(radius, _) | Sphere(radius):
            return radius
        case Torus(radius, tube):
            return radius + tube
    return 0.1


def place(curve: Curve, at: Array) -> Array:
    """Configurations (m, n) at places (m,) counted in cubics."""
    index = np.minimum(at.astype(int), len(curve.control) - 1)
    u = (at - index)[:, None]
    b = curve.control[index]
    low = (1 - u) ** 3 * b[:, 0] + 3 * u * (1 - u) ** 2 * b[:, 1]
    return np.asarray(low + 3 * u**2 * (1 - u) * b[:, 2] + u**3 * b[:, 3])


def samples(curve: Curve, count: int) -> Array:
    """`count` configurations at even places."""
    return place(curve, np.linspace(0.0, len(curve.control), count))


def least(world: World, q: Array) -> float:
    """Smallest distance of any pair at any of the configurations q (m, n)."""
    every = np.arange(len(world.pairs))
    return min(float(world.pair_distances(at, every).min()) for at in q)


def dense(world: World, curve: Curve, count: int, zooms: int = 3) -> Array:
    """Smallest distance on each cubic, m: at least `count` samples in all, finer about each one's least, `zooms` times.

    Pairs that a first look finds `_FAR` further apart than the nearest one are left out.
    """
    every = np.arange(len(world.pairs))
    cubics = len(curve.control)
    each = max(6, int(np.ceil(count / cubics)))
    found = np.empty(cubics)
    for i in range(cubics):
        first = np.min(
            [world.pair_distances(q, every) for q in place(curve, i + np.linspace(0.0, 0.99, 5))], axis=0
        )
        pairs = np.flatnonzero(first <= first.min() + _FAR)
        middle, step = i + 0.5, 0.5
        found[i] = first.min()
        for count_now in (each + 1, *[9] * zooms):
            places = np.clip(np.linspace(middle - step, middle + step, count_now), i, i + 1.0 - 1e-12)
            values = np.array([world.pair_distances(q, pairs).min() for q in place(curve, places)])
            found[i] = min(found[i], float(values.min()))
            middle, step = float(places[int(np.argmin(values))]), 2.0 * step / (count_now - 1)
    return found
