"""Verdicts on motions of joints, beside Tesseract's continuous check and Drake's: who is right, and at what cost?

python bench/foreign_peers.py --motions 100

Arms and bodies are those of `bench/foreign.py`; only the sliding carriage is left out. Each motion has 3 to 8 points,
straight lines of the joints between them, and a clearance to be kept, which in every second case differs by a normally
distributed 0.5 mm from the least distance that MuJoCo finds. Motions that collide are drawn again, except every tenth,
where only the begin is free. All get the same URDF, with pairs that are not checked:

- `a465 certify`'s proof;
- Tesseract: Bullet's cast shapes (LVS_CONTINUOUS) between steps of 0.05 and 0.005 rad;
- Drake: `SceneGraphCollisionChecker.CheckEdgeCollisionFree`, samples at the same steps, with the clearance as padding.

MuJoCo judges, at samples no more than 0.002 rad apart, and about the nearest one at 1/50 of that. A verdict "clear" is
wrong if a sample is nearer than the clearance; "refuted" is wrong if none is; both by more than 1 um. The gap is how
far the least distance that a check states of a free motion lies below MuJoCo's. Drake's check states none.

Drake's proof is asked apart, because `CspaceFreePath`, which is for motions, is not in the wheel: `CspaceFreePolytope`,
where one joint moves and the others are welded, so that its interval of tan(q / 2) is the motion itself. It has no
clearance, so 0 is asked of both.

CPU is process time of a check, without the reading of the scene.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "support"))

from foreign import ARMS, COARSE, FINE, JUDGED, MOST_DRAWN, drawn, least, obstacles, samples
from peers.drake_motion import Edges, proved_free
from peers.scene_text import scene_urdf
from peers.tesseract_motion import Casts
from run_conditions import run_conditions

from arm.robot.model import Robot
from arm.robot.shapes import Body
from arms.made_up import MujocoArm, arm
from cell.foreign.judge import certified
from cell.foreign.trajectory_file import JointTrajectory
from plan.collision.bezier import Curve
from plan.collision.world import World

STEPS = (0.05, 0.005)  # rad
REACH = 0.1  # m within which distances are told
FURTHEST = 1.0  # rad that one joint moves


@dataclass
class Row:
    """What one check said.

    Attributes:
        verdicts: "clear", "refuted" or "undecided" of each motion.
        wrong: mm by which wrong verdicts are wrong; positive if clear was said, negative if refuted.
        gap: m, of motions whose least distance is told.
        cpu: s.
    """

    verdicts: list[str] = field(default_factory=list)
    wrong: list[float] = field(default_factory=list)
    gap: list[float] = field(default_factory=list)
    cpu: list[float] = field(default_factory=list)

    def judged(self, verdict: str, required: float, true: float) -> None:
        self.verdicts.append(verdict)
        off = required - true
        if (verdict == "clear" and off > JUDGED) or (verdict == "refuted" and off < -JUDGED):
            self.wrong.append(1e3 * off)

    def timed(self, check: Callable[[], bool]) -> bool:
        begun = time.process_time()
        found = check()
        self.cpu.append(time.process_time() - begun)
        return found


@dataclass(frozen=True, eq=False)
class Case:
    """An arm among bodies, and a motion of it."""

    robot: Robot
    bodies: list[Body]
    judge: MujocoArm
    text: str
    trajectory: JointTrajectory
    links: list[str]
    rng: np.random.Generator

    def true(self, limit: float) -> float:
        """Return the least distance that MuJoCo finds along the motion, at most `limit`, m."""
        return _nearest(self.judge, self.trajectory, limit)


def drawn_case(seed: int, name: str, folder: Path) -> Case:
    """Return a motion that is free, or, every tenth, one that begins free."""
    rng = np.random.default_rng([2027, seed])
    robot = arm(folder, *ARMS[name])
    for _ in range(MOST_DRAWN):
        bodies = obstacles(rng)
        trajectory = drawn(rng, robot, folder / "trajectory.json", cubics=False)
        judge = MujocoArm(folder / "arm.urdf", robot, bodies)
        checked = trajectory.q[:1] if seed % 10 == 9 else trajectory.at(samples(trajectory, COARSE))[0]
        if least(judge, checked, REACH) > 0.0:
            text = (folder / "arm.urdf").read_text()
            return Case(robot, bodies, judge, text, trajectory, [b.name for b in robot.bodies], rng)
    raise ValueError(f"seed {seed}: no motion that begins free")


def compare(case: Case, seed: int, rows: dict[str, Row], folder: Path) -> None:
    """Add what each check says of a motion of all joints."""
    true = case.true(REACH)
    required = max(0.0, true + case.rng.normal(0.0, 5e-4)) if seed % 2 else case.rng.uniform(0.0, 0.03)
    world, q = World(case.robot, case.bodies), case.trajectory.q
    row = rows["a465"]
    begun = time.process_time()
    check = certified(world, case.trajectory.curve, required)
    row.cpu.append(time.process_time() - begun)
    refuted = "refuted" if check.seen < required else "undecided"
    row.judged("clear" if check.proved else refuted, required, true)
    told = 0.0 < true < REACH
    if told:
        row.gap.append(true - certified(world, case.trajectory.curve, 0.0).clearance)
    urdf, allowed = scene_urdf(case.text, case.bodies), case.robot.disabled_collisions
    casts = Casts(urdf, case.links, allowed, folder)
    for step in STEPS:
        row = rows[f"Tesseract, {step:g} rad"]
        touches = row.timed(partial(casts.touches, q, required, step))
        row.judged("refuted" if touches else "clear", required, true)
        if told:
            row.gap.append(true - casts.least(q, REACH, step))
        row = rows[f"Drake's samples, {step:g} rad"]
        edges = Edges(urdf, case.links, allowed, required, step)
        touches = row.timed(partial(edges.touches, q))
        row.judged("refuted" if touches else "clear", required, true)


def compare_one_joint(case: Case, rows: dict[str, Row]) -> None:
    """Add what both proofs say of a motion of one joint, with no clearance."""
    limits = case.robot.model
    joint, q = int(case.rng.integers(len(case.robot.joint_names))), case.trajectory.q[0]
    far = q[joint] + case.rng.uniform(-FURTHEST, FURTHEST)
    low, high = limits.lowerPositionLimit[joint], limits.upperPositionLimit[joint]
    end = float(np.clip(far, max(low, -np.pi), min(high, np.pi)))
    path = np.repeat(q[None], 2 + int(abs(end - q[joint]) / FINE), axis=0)
    path[:, joint] = np.linspace(q[joint], end, len(path))
    true = least(case.judge, path, REACH)
    control = np.linspace(path[0], path[-1], 4)[None]
    row = rows["a465"]
    begun = time.process_time()
    check = certified(World(case.robot, case.bodies), Curve(control, np.array([1.0])), 0.0)
    row.cpu.append(time.process_time() - begun)
    row.judged("clear" if check.proved else "refuted" if check.seen < 0.0 else "undecided", 0.0, true)
    names = case.robot.joint_names
    welded = {name: float(q[k]) for k, name in enumerate(names) if k != joint}
    urdf = scene_urdf(case.text, case.bodies, welded)
    row = rows["Drake"]
    allowed = case.robot.disabled_collisions
    proved = row.timed(partial(proved_free, urdf, case.links, allowed, float(q[joint]), end))
    row.judged("clear" if proved else "undecided", 0.0, true)


def _nearest(judge: MujocoArm, trajectory: JointTrajectory, limit: float) -> float:
    """Return the least distance at samples, with finer ones about the nearest."""
    coarse = samples(trajectory, COARSE)
    seen = [judge.least(q, limit=limit) for q in trajectory.at(coarse)[0]]
    fine = samples(trajectory, FINE)
    near = np.array(seen) < min(seen) + COARSE * 2.0  # no point of these arms moves by 2 m for 1 rad
    spans = [
        (coarse[max(k - 1, 0)], coarse[min(k + 1, len(coarse) - 1)]) for k in np.flatnonzero(near).tolist()
    ]
    inside = [(fine >= a) & (fine <= b) for a, b in spans]
    close = fine[np.array(inside).any(axis=0)]
    found = [judge.least(q, limit=limit) for q in trajectory.at(close)[0]]
    k = int(np.argmin(found))
    around = np.linspace(close[max(k - 1, 0)], close[min(k + 1, len(close) - 1)], 101)
    return min(*found, *(judge.least(q, limit=limit) for q in trajectory.at(around)[0]))


def _print(rows: dict[str, Row], gaps: bool) -> None:
    print("\n| check | clear | refuted | undecided | wrongly clear, worst | wrongly refuted, worst |", end="")
    print(" gap mm, median, 95 %, most |" if gaps else "", "CPU ms, median, 95 % | CPU over a465's, median |")
    print("|---|---|---|---|---|---|" + ("---|" if gaps else "") + "---|---|")
    ours = np.array(rows["a465"].cpu)
    for name, row in rows.items():
        counts = " | ".join(str(row.verdicts.count(v)) for v in ("clear", "refuted", "undecided"))
        wrong = np.array(row.wrong)
        both = [
            f"{len(part)}" + (f", {np.abs(part).max():.2f} mm" if len(part) else "")
            for part in (wrong[wrong > 0.0], wrong[wrong < 0.0])
        ]
        gap = 1e3 * np.array(row.gap)
        told = f"{np.median(gap):.3f}, {np.percentile(gap, 95):.3f}, {gap.max():.3f}" if len(gap) else "-"
        ms = 1e3 * np.array(row.cpu)
        times = (
            f"{np.median(ms):.1f}, {np.percentile(ms, 95):.1f} | {np.median(np.array(row.cpu) / ours):.2f}"
        )
        print(f"| {name} | {counts} | {' | '.join(both)} | " + (f"{told} | " if gaps else "") + f"{times} |")


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--motions", type=int, default=100)
    parser.add_argument("--first", type=int, default=0, help="seed of the first one")
    given = parser.parse_args()
    print(run_conditions(), flush=True)
    checks = [f"{name}, {step:g} rad" for name in ("Tesseract", "Drake's samples") for step in STEPS]
    all_joints = {name: Row() for name in ("a465", *checks)}
    one_joint = {name: Row() for name in ("a465", "Drake")}
    names = [name for name in ARMS if name != "rail"]
    with tempfile.TemporaryDirectory() as folder:
        for seed in range(given.first, given.first + given.motions):
            case = drawn_case(seed, names[seed % len(names)], Path(folder))
            compare(case, seed, all_joints, Path(folder))
            compare_one_joint(case, one_joint)
    print("\nAll joints move:", end="")
    _print(all_joints, gaps=True)
    print("\nOne joint moves, no clearance asked:", end="")
    _print(one_joint, gaps=False)


if __name__ == "__main__":
    main()
