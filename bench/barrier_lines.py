"""Lines that a follower with collision barriers solves where the blind one is refused, checked by dense sampling.

python bench/barrier_lines.py --scenes 250 --others 100
"""

from __future__ import annotations

import argparse
import os
import platform
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache
from importlib.metadata import version
from itertools import combinations
from pathlib import Path

import coal
import numpy as np
import pinocchio as pin
from scipy.interpolate import CubicSpline

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "tests" / "support"))

from peers.coal_shapes import coal_shape, coal_transform  # noqa: E402

from arm.controller.unit import Limits, load_unit  # noqa: E402
from arm.errors import ImpossibleError  # noqa: E402
from arm.robot.model import Robot, load_a465  # noqa: E402
from arm.robot.shapes import Body, Cylinder, Sphere  # noqa: E402
from arm.robot.tool import urdf_limits  # noqa: E402
from arm.se3 import Array, frozen, rot_x, rot_z, transform  # noqa: E402
from arms.made_up import SEVEN, arm  # noqa: E402
from plan.cartesian.clear_line import ClearLine, follow_clear_line  # noqa: E402
from plan.cartesian.collision_barrier import collision_barrier  # noqa: E402
from plan.cartesian.line import Line, LineOptions, follow_line  # noqa: E402
from plan.cartesian.line_samples import LineSamples  # noqa: E402
from plan.collision.bezier import curve_of_path  # noqa: E402
from plan.collision.certificate import certify_curve  # noqa: E402
from plan.collision.search_margin import LINE_MARGIN  # noqa: E402
from plan.collision.world import World  # noqa: E402
from plan.kinematics.ik import inverse_kinematics  # noqa: E402
from plan.kinematics.numeric_ik import solve_ik  # noqa: E402
from plan.options import SOLVERS  # noqa: E402
from plans.barred_lines import clear_starts, hole_scene, towards  # noqa: E402

CLEARANCE = 0.005  # m
PLAIN = LineOptions(tolerance=5e-6)
TOP = 0.15  # m, length of an approach
YAWS = 24  # of the tool at the beginning of an approach, for the blind follower
STEP = 0.002  # rad, between samples of the check
MARGIN, NEAR = 1e-3, 0.05  # m, of the barriers without a way


@dataclass(frozen=True, eq=False)
class Case:
    """One line.

    Attributes:
        family: hole, post or seven joints.
        bodies: around the arm.
        world, limits, line: of the problem.
        starts: configurations at its beginning, the one with the most room first; one if it is given.
        free_axis: what the line leaves free of the rotation.
    """

    family: str
    bodies: Sequence[Body]
    world: World
    limits: Limits
    line: Callable[[Array], Line]
    starts: Sequence[Array]
    free_axis: str | None


@dataclass(frozen=True)
class Result:
    """What became of a line.

    Attributes:
        family: of the case.
        blind: whether the blind follower's line is certified, from the first start.
        blind_any: from any of the starts.
        solved: by solver, whether the follower with barriers turns it into a certified line, from the first start.
        parts: the same with barriers alone, and with the way alone.
        possible: whether some yaw is clear at each place of the line, with its start's solutions or any others.
        cpu: by solver, s for the line from the first start, the blind attempt included.
        blind_cpu: s of the blind attempt.
        truth, off: least distance of the solved line by sampling, m, and largest distance of the tool from it, m.
    """

    family: str
    blind: bool
    blind_any: bool
    solved: dict[str, bool]
    parts: tuple[bool, bool]
    possible: bool
    cpu: dict[str, float]
    blind_cpu: float
    truth: float
    off: float


def a465() -> tuple[Robot, Limits]:
    return load_a465(0.134112, 0.06), load_unit("crs97").limits()


@cache
def seven() -> tuple[Robot, Limits]:
    with tempfile.TemporaryDirectory() as folder:
        robot = arm(Path(folder), SEVEN, [("l0", "l2"), ("l2", "l4"), ("l4", "l6")])
    return robot, urdf_limits(robot, 4.0)


def hole(seed: int) -> Case | None:
    """Straight down to a hole, any yaw: a low plate stands beside the hole, a post hangs beside the approach."""
    robot, limits = a465()
    at, bodies = hole_scene(seed)
    world = World(robot, bodies)
    yaws = np.linspace(-np.pi, np.pi, YAWS, endpoint=False)
    tops = [transform(rot_x(np.pi) @ rot_z(yaw), at + [0.0, 0.0, TOP]) for yaw in yaws]
    starts = clear_starts(world, limits, tops, CLEARANCE)

    def line(q: Array) -> Line:
        T = robot.T_base_tool(q)
        return Line(T, frozen(transform(T[:3, :3], T[:3, 3] - [0.0, 0.0, TOP])))

    return Case("hole", bodies, world, limits, line, starts, "z") if starts else None


def post(seed: int) -> Case | None:
    """20 cm sideways past a post, any yaw, from a yaw that is given."""
    robot, limits = a465()
    rng = np.random.default_rng([2, seed])
    middle = np.array([rng.uniform(0.36, 0.46), rng.uniform(-0.15, 0.15), rng.uniform(0.05, 0.12)])
    way = rng.uniform(-np.pi, np.pi)
    side = towards(way + rng.choice([-1, 1]) * np.pi / 2)
    stands = middle + (rng.uniform(0.036, 0.046) + 0.012) * side + rng.uniform(-0.05, 0.05) * towards(way)
    bodies = [Body("post", Cylinder(0.012, 0.1), transform(t=stands - [0.0, 0.0, 0.02]), "wall")]
    world = World(robot, bodies)
    start = transform(rot_x(np.pi) @ rot_z(rng.uniform(-np.pi, np.pi)), middle - 0.1 * towards(way))
    end = transform(start[:3, :3], middle + 0.1 * towards(way))
    starts = clear_starts(world, limits, [start], CLEARANCE)[:1]
    line = Line(frozen(start), frozen(end))
    return Case("post", bodies, world, limits, lambda q: line, starts, "z") if starts else None


def elbow(seed: int) -> Case | None:
    """20 cm straight on with an arm of seven joints, no free direction: a ball where the elbow would pass."""
    robot, limits = seven()
    rng = np.random.default_rng([3, seed])
    at = (rng.uniform(0.3, 0.5), rng.uniform(-0.3, 0.3), rng.uniform(0.15, 0.35))
    start = transform(rot_x(np.pi) @ rot_z(rng.uniform(-np.pi, np.pi)), at)
    way = rng.normal(size=3)
    line = Line(
        frozen(start), frozen(transform(start[:3, :3], start[:3, 3] + 0.2 * way / np.linalg.norm(way)))
    )
    alone = World(robot, [])
    found = [
        q for q in solve_ik(robot, start, limits.lower, limits.upper).q if not alone.in_collision(q, 0.02)
    ]
    if not found:
        return None
    q = found[int(rng.integers(len(found)))]
    try:
        path = follow_line(robot, q, line.T_start, line.T_end, limits, PLAIN)
    except ImpossibleError:
        return None
    there = path.q[int(rng.integers(len(path.q) // 2, len(path.q)))]
    came, comes = elbow_at(robot, q), elbow_at(robot, there)
    ahead = (comes - came) / max(float(np.linalg.norm(comes - came)), 1e-9)
    for _ in range(8):
        centre = comes + rng.uniform(0.03, 0.08) * ahead + rng.normal(scale=0.02, size=3)
        bodies = [Body("ball", Sphere(0.03), transform(t=centre), "wall")]
        world = World(robot, bodies)
        if world.in_collision(there, CLEARANCE) and not world.in_collision(q, CLEARANCE):
            return Case("seven joints", bodies, world, limits, lambda q: line, [q], None)
    return None


def elbow_at(robot: Robot, q: Array) -> Array:
    """Where the upper arm ends."""
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, np.asarray(q))
    return np.array(data.oMi[4].translation)


def certified(case: Case, q: Array, options: LineOptions) -> bool:
    """Whether the line as these options give it is certified."""
    line = case.line(q)
    try:
        path = follow_line(case.world.robot, q, line.T_start, line.T_end, case.limits, options)
    except ImpossibleError:
        return False
    curve = curve_of_path(CubicSpline(path.s, path.q))
    return certify_curve(case.world, curve, CLEARANCE + LINE_MARGIN).proved


def judged(case: Case) -> Result:
    """Follow one line in all ways."""
    world, limits, q = case.world, case.limits, case.starts[0]
    line, free = case.line(q), replace(PLAIN, free_axis=case.free_axis)
    began = time.process_time()
    blind = certified(case, q, PLAIN)
    blind_cpu = time.process_time() - began
    # where a turn is free, the blind follower may use it, too: it turns as little as it can
    blind = blind or certified(case, q, free)
    blind_any = blind or any(certified(case, other, PLAIN) for other in case.starts[1:])
    solved, cpu = {}, {}
    best: ClearLine | None = None
    for solver in SOLVERS:
        began = time.process_time()
        options = replace(PLAIN, solver=solver)
        try:
            found = follow_clear_line(world, CLEARANCE, q, line, limits, options, case.free_axis)
        except ImpossibleError:
            found = None
        cpu[solver] = time.process_time() - began
        solved[solver] = found is not None and found.check.proved
        best = found if best is None and solved[solver] else best
    kept = CLEARANCE + MARGIN
    way = LineSamples(world.robot, q, line, limits, case.free_axis).way(world, kept, kept)
    parts = (
        certified(case, q, replace(free, barrier=collision_barrier(world, kept, kept + NEAR))),
        way is not None and certified(case, q, replace(free, way=way)),
    )
    truth, off = (np.inf, 0.0) if best is None else sampled(case, line, best)
    possible = best is not None or blind or somewhere_clear(case, line)
    return Result(case.family, blind, blind_any, solved, parts, possible, cpu, blind_cpu, truth, off)


def somewhere_clear(case: Case, line: Line) -> bool:
    """Whether each of 31 places has a clear solution at one of 72 yaws, for the A465; true for other arms."""
    if case.free_axis is None:
        return True
    yaws = [rot_z(yaw) for yaw in np.linspace(-np.pi, np.pi, 72, endpoint=False)]
    for T in line.poses(np.linspace(0.0, 1.0, 31)):
        poses = np.stack([transform(T[:3, :3] @ yaw, T[:3, 3]) for yaw in yaws])
        found = inverse_kinematics(case.world.robot, poses, case.limits.lower, case.limits.upper).q
        if all(case.world.in_collision(q, CLEARANCE) for q in found):
            return False
    return True


def sampled(case: Case, line: Line, found: ClearLine) -> tuple[float, float]:
    """Least distance of all pairs by coal alone and largest distance of the tool from the line, dense samples; m."""
    robot, bodies = case.world.robot, case.bodies
    spline = CubicSpline(found.path.s, found.path.q)
    count = int(np.abs(np.diff(found.path.q, axis=0)).max(axis=1).sum() / STEP) + 2
    q = spline(np.linspace(0.0, found.path.s[-1], count))
    if not ((q >= case.limits.lower - 1e-6) & (q <= case.limits.upper + 1e-6)).all():
        return -np.inf, np.inf
    shapes = {b.name: coal_shape(b.shape) for b in robot.bodies} | {
        b.name: coal_shape(b.shape) for b in bodies
    }
    pairs = [
        (a.name, b.name)
        for a, b in combinations(robot.bodies, 2)
        if a.joint != b.joint and frozenset((a.name, b.name)) not in robot.disabled_collisions
    ]
    pairs += [(a.name, b.name) for a in robot.bodies if a.joint > 0 for b in bodies]
    least, away = np.inf, 0.0
    start, end = line.T_start[:3, 3], line.T_end[:3, 3]
    along = (end - start) / np.linalg.norm(end - start)
    for one in q:
        at = {b.name: coal_transform(b.T_base_body) for b in (*robot.bodies_at(one), *bodies)}
        for a, b in pairs:
            result = coal.DistanceResult()
            distance = coal.distance(shapes[a], at[a], shapes[b], at[b], coal.DistanceRequest(), result)
            least = min(least, float(distance))
        tip = robot.T_base_tool(one)[:3, 3] - start
        away = max(away, float(np.linalg.norm(tip - (tip @ along) * along)))
    return least, away


def main() -> None:
    """Draw, follow, check, print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scenes", type=int, default=250, help="seeds of holes")
    parser.add_argument(
        "--others", type=int, default=100, help="seeds of posts, and of arms with seven joints"
    )
    options = parser.parse_args()
    libraries = ", ".join(f"{name} {version(name)}" for name in ("a465", "numpy", "pin", "coal", *SOLVERS))
    print(
        f"conditions: Python {platform.python_version()}, {libraries}; {os.cpu_count()} processors, load "
        f"{os.getloadavg()[0]:.1f}; clearance {CLEARANCE * 1e3:g} mm\n"
        f"  hole: {TOP * 1e3:g} mm down to a hole, a plate beside it and a post at the approach, seeds 0 to "
        f"{options.scenes - 1}; post: 200 mm past a post; seven joints: 200 mm, a ball where the elbow would pass; "
        f"seeds 0 to {options.others - 1} each\n"
        f"  check: coal alone, all pairs, at steps of {STEP:g} rad; CPU: process time of one line",
        flush=True,
    )
    results: list[Result] = []
    for make, count in ((hole, options.scenes), (post, options.others), (elbow, options.others)):
        cases = [case for case in map(make, range(count)) if case is not None]
        results += [judged(case) for case in cases]
    report(results)


def report(results: Sequence[Result]) -> None:
    """Print the tables."""
    print(
        "\n| lines | drawn | refused to the blind follower | of these refused from every other yaw, too | certified "
        "with barriers: daqp | osqp | barriers without a way | way without barriers | no yaw is clear somewhere |"
    )
    print("|---|---|---|---|---|---|---|---|---|")
    for family in (*dict.fromkeys(r.family for r in results), "all"):
        some = [r for r in results if family in (r.family, "all")]
        refused = [r for r in some if not r.blind]
        counts = [len(some), len(refused), sum(not r.blind_any for r in refused)]
        counts += [sum(r.solved[solver] for r in refused) for solver in SOLVERS]
        counts += [sum(r.parts[k] for r in refused) for k in (0, 1)]
        counts.append(sum(not r.possible for r in refused))
        print(f"| {family} | " + " | ".join(map(str, counts)) + " |")
    refused = [r for r in results if not r.blind]
    both = [r for r in refused if all(r.solved.values())]
    blind = np.array([r.blind_cpu for r in both])
    print("\n| CPU per line that becomes certified, ms | median | p95 | over the blind attempt, median |")
    print("|---|---|---|---|")
    print(f"| blind attempt, refused | {quantiles(blind)} | 1.0 |")
    for solver in SOLVERS:
        cpu = np.array([r.cpu[solver] for r in both])
        print(f"| {solver}, blind attempt included | {quantiles(cpu)} | {np.median(cpu / blind):.1f} |")
    lost = np.array([r.cpu["daqp"] for r in refused if not r.solved["daqp"]] or [0.0])
    print(f"| daqp, where it stays refused | {quantiles(lost)} | |")
    checked = [r for r in refused if any(r.solved.values())]
    short = [r for r in checked if r.truth < CLEARANCE]
    print(
        f"\nindependent check of {len(checked)} lines: {len(short)} with less than {CLEARANCE * 1e3:g} mm; least "
        f"{min(r.truth for r in checked) * 1e3:.3f} mm; the tool is at most {max(r.off for r in checked) * 1e6:.1f} um "
        "off its line"
    )


def quantiles(seconds: Array) -> str:
    return f"{1e3 * np.median(seconds):.0f} | {1e3 * np.quantile(seconds, 0.95):.0f}"


if __name__ == "__main__":
    main()
