"""Are verdicts on trajectories of other programs right? MuJoCo judges what `a465 certify` proves or refutes.

python bench/foreign.py --trajectories 2000

Each trajectory is of one of five made-up or well-known arms with 5 to 7 joints (tests/support/arms/made_up.py), among 4
boxes, cylinders, capsules and spheres at random poses in its reach. It has 3 to 8 points 0.2 to 0.8 s apart, with
velocities (cubics) in two of three cases and without (straight lines) in the others, and is read from a
JointTrajectory file with its joints in another order. The required clearance is drawn so that verdicts are hard: in
every second case it differs by a normally distributed 0.5 mm from the least distance that coarse samples show, in the
others it is up to 30 mm. Trajectories that begin in collision are drawn again, except every tenth.

Wrong: clear, although MuJoCo, whose parser and collisions have nothing of ours, finds less at a sample (no joint moves
by more than 0.002 rad or m between two); or refuted, but MuJoCo finds the required clearance at the moment that is
named. Both with 1 um for MuJoCo's own errors.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "support"))

from run_conditions import run_conditions

from arm.robot.model import Robot
from arm.robot.shapes import Body, Box, Capsule, Cylinder, Shape, Sphere
from arm.se3 import Array, rot_x, rot_z, transform
from arms.made_up import PANDA, RAIL, SEVEN, UR5, UR_LIKE, MujocoArm, arm
from cell.foreign.judge import certified
from cell.foreign.trajectory_file import JointTrajectory, read_trajectory
from plan.collision.world import World

EVEN = [("l0", "l2"), ("l2", "l4"), ("l4", "l6")]  # links beside a link of no length, which always overlap
ARMS = {
    "UR-like": (UR_LIKE, EVEN[:1]),
    "seven": (SEVEN, EVEN),
    "rail": (RAIL, []),
    "UR5": (UR5, EVEN[:1]),
    "Panda": (PANDA, [*EVEN, ("l1", "l3"), ("l3", "l5"), ("l5", "l7")]),
}
COARSE, FINE = 0.02, 0.002  # rad or m between samples
JUDGED = 1e-6  # m
MOST_DRAWN = 50


def obstacles(rng: np.random.Generator) -> list[Body]:
    """Bodies at random poses around an arm."""
    shapes: list[Shape] = [
        Box(tuple(rng.uniform(0.05, 0.3, 3))),
        Cylinder(rng.uniform(0.03, 0.1), rng.uniform(0.1, 0.4)),
        Capsule(rng.uniform(0.03, 0.08), rng.uniform(0.1, 0.4)),
        Sphere(rng.uniform(0.05, 0.12)),
    ]
    found = []
    for k, shape in enumerate(shapes):
        angle, away = rng.uniform(-np.pi, np.pi), rng.uniform(0.35, 0.75)
        R = rot_z(rng.uniform(-3, 3)) @ rot_x(rng.uniform(-3, 3))
        at = (away * np.cos(angle), away * np.sin(angle), rng.uniform(0.0, 0.8))
        found.append(Body(f"body {k}", shape, transform(R, at), "wall"))
    return found


def drawn(rng: np.random.Generator, robot: Robot, file: Path, cubics: bool | None = None) -> JointTrajectory:
    """Write a trajectory and read it; it has cubics, or straight lines, or either by chance."""
    low, high = (
        np.clip(robot.model.lowerPositionLimit, -2.5, 2.5),
        np.clip(robot.model.upperPositionLimit, -2.5, 2.5),
    )
    count, chance = int(rng.integers(3, 9)), rng.random() < 2.0 / 3.0
    cubics = chance if cubics is None else cubics
    q = rng.uniform(low, high) + np.cumsum(rng.normal(0.0, 0.12, (count, len(low))), axis=0)
    q = np.clip(q, low, high)
    times = np.cumsum(rng.uniform(0.2, 0.8, count))
    rates = np.gradient(q, times, axis=0)
    rates[[0, -1]] = 0.0
    order = rng.permutation(len(low))
    names = [robot.joint_names[k] for k in order]
    points = [
        {
            "positions": q[k, order].tolist(),
            "velocities": rates[k, order].tolist() if cubics else [],
            "time_from_start": {"sec": int(times[k]), "nanosec": int(1e9 * (times[k] % 1.0))},
        }
        for k in range(count)
    ]
    file.write_text(json.dumps({"joint_names": names, "points": points}))
    return read_trajectory(file, robot.joint_names)


def samples(trajectory: JointTrajectory, step: float) -> Array:
    """Return times between which no joint moves by more than a step, s from the first point."""
    a, lasts = trajectory.coefficients, np.diff(trajectory.times)
    most = (np.abs(a) * np.array([1.0, 2.0, 3.0])[:, None, None]).sum(axis=0).max(axis=1)
    begins = trajectory.times[:-1] - trajectory.times[0]
    parts = [
        begin + last * np.linspace(0.0, 1.0, 2 + int(rate / step))
        for begin, last, rate in zip(begins, lasts, most, strict=True)
    ]
    return np.unique(np.concatenate(parts))


def least(judge: MujocoArm, q: Array, limit: float) -> float:
    """Return the least distance at configurations (k, n), at most `limit`, m."""
    return min((judge.least(one, limit=limit) for one in q), default=limit)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--trajectories", type=int, default=2000)
    parser.add_argument("--first", type=int, default=0, help="seed of the first one")
    options = parser.parse_args()
    print(run_conditions(), flush=True)
    counts: dict[str, Counter[str]] = {name: Counter() for name in ARMS}
    cpu: dict[str, list[float]] = {name: [] for name in ARMS}
    with tempfile.TemporaryDirectory() as folder:
        for seed in range(options.first, options.first + options.trajectories):
            name = list(ARMS)[seed % len(ARMS)]
            verdict, wrong, took = case(seed, name, Path(folder))
            counts[name][verdict] += 1
            counts[name]["wrong"] += bool(wrong) and verdict != "undecided"
            cpu[name].append(took)
            if wrong or verdict == "undecided":
                print(f"{verdict}, seed {seed}, {name}: {wrong}", flush=True)
    print("\n| arm | trajectories | clear | refuted | undecided | wrong | CPU ms, median, 95 %, most |")
    print("|---|---|---|---|---|---|---|")
    for name, found in counts.items():
        ms = 1e3 * np.array(cpu[name] or [np.nan])
        times = f"{np.median(ms):.0f}, {np.percentile(ms, 95):.0f}, {ms.max():.0f}"
        print(
            f"| {name} | {len(cpu[name])} | "
            + " | ".join(str(found[what]) for what in ("clear", "refuted", "undecided", "wrong"))
            + f" | {times} |"
        )


def case(seed: int, name: str, folder: Path) -> tuple[str, str, float]:
    """Return the verdict on one trajectory, why it is wrong or undecided ("" if it is right), and the CPU time, s."""
    rng = np.random.default_rng([2026, seed])
    robot = arm(folder, *ARMS[name])
    for _ in range(MOST_DRAWN):
        bodies = obstacles(rng)
        trajectory = drawn(rng, robot, folder / "trajectory.json")
        judge = MujocoArm(folder / "arm.urdf", robot, bodies)
        if seed % 10 == 9 or judge.least(trajectory.q[0]) > 0.0:
            break
    seen = least(judge, trajectory.at(samples(trajectory, COARSE))[0], 0.1)
    required = max(0.0, seen + rng.normal(0.0, 5e-4)) if seed % 2 else rng.uniform(0.0, 0.03)
    begun = time.process_time()
    check = certified(World(robot, bodies), trajectory.curve, required)
    took = time.process_time() - begun
    if check.proved:
        found = least(judge, trajectory.at(samples(trajectory, FINE))[0], required + 0.01)
        wrong = f"{1e3 * found:.4f} mm, {1e3 * required:.4f} required" if found < required - JUDGED else ""
        return "clear", wrong, took
    if check.seen >= required:
        return (
            "undecided",
            f"{1e3 * check.clearance:.4f} proved, {1e3 * check.seen:.4f} seen, {1e3 * required:.4f} mm",
            took,
        )
    found = judge.least(trajectory.at(np.array([check.time]))[0][0], limit=required + 0.1)
    return (
        "refuted",
        f"{1e3 * found:.4f} mm at {check.time:.4f} s" if found >= required + JUDGED else "",
        took,
    )


if __name__ == "__main__":
    main()
