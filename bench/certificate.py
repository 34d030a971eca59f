"""The collision certificate against adversarial motions that graze obstacles, checked by dense sampling.

python bench/certificate.py --cases 10000
"""

from __future__ import annotations

import argparse
import os
import platform
import sys
import time
from collections import Counter
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "tests" / "support"))

from arms.grazing import ARMS, MOTIONS, NEAR, OBSTACLES, Case, dense, draw, place  # noqa: E402
from plan.collision.certificate import RESOLUTION, certify_curve  # noqa: E402
from plan.collision.world import DISTANCE_ERROR  # noqa: E402

DENSER = 20  # samples per configuration that the proof looked at
LEAST_SAMPLES = 240
STEP = 0.01  # rad, largest joint step of the sampling that is timed
TOLERANCE = 1e-6  # m, of the distances that both sides rest on
UNDECIDED = RESOLUTION + 2 * DISTANCE_ERROR + TOLERANCE  # m above what is asked where decide mode may give up


@dataclass(frozen=True)
class Result:
    """One case.

    Attributes:
        kind: arm, motion, body.
        off: closest approach less what is asked, m.
        truth: closest approach found by sampling, m.
        gap: the same less the bound of tight mode, m.
        wrong: what was wrong, for people; empty if nothing was.
        proved: the verdict of decide mode.
        cpu: s in tight mode, in decide mode, and for sampling in steps of `STEP`.
        evaluations: in tight and in decide mode, and steps of the sampling.
    """

    kind: tuple[str, str, str]
    off: float
    truth: float
    gap: float
    wrong: str
    proved: bool
    cpu: tuple[float, float, float]
    evaluations: tuple[int, int, int]


def main() -> None:
    """Draw, check, print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cases", type=int, default=10_000)
    parser.add_argument("--first-seed", type=int, default=0)
    options = parser.parse_args()
    libraries = ", ".join(f"{name} {version(name)}" for name in ("a465", "numpy", "pin", "coal"))
    print(
        f"conditions: Python {platform.python_version()}, {libraries}; {os.cpu_count()} processors, load "
        f"{os.getloadavg()[0]:.1f}; {options.cases} cases from seed {options.first_seed}\n"
        f"  arms {', '.join(ARMS)}; motions {', '.join(MOTIONS)}; bodies {', '.join(OBSTACLES)}\n"
        f"  closest approach aimed at {NEAR[0] * 1e3:g} to {NEAR[1] * 1e3:g} mm from what is asked; truth: {DENSER} "
        f"samples for each configuration that the proof looked at, at least {LEAST_SAMPLES}, refined about the least "
        f"of each cubic; tolerance {TOLERANCE * 1e6:g} um\n"
        f"  CPU: process time, worlds and broadphase built before; sampling: World.in_collision each {STEP:g} rad, "
        "to the first hit",
        flush=True,
    )
    results = [
        judge(draw(seed), seed) for seed in range(options.first_seed, options.first_seed + options.cases)
    ]
    report(results)
    if any(r.wrong for r in results):
        sys.exit(1)


def judge(case: Case, seed: int) -> Result:
    """The certificate in both modes against sampling."""
    world, curve, asked = case.world, case.curve, case.clearance
    world.in_collision(place(curve, np.zeros(1))[0], asked)
    cpu, found = [], []
    for mode in (True, False):
        began = time.process_time()
        found.append(certify_curve(world, curve, asked, tight=mode))
        cpu.append(time.process_time() - began)
    began = time.process_time()
    steps = _sampled(case)
    cpu.append(time.process_time() - began)
    tight, decided = found
    sampled = dense(world, curve, max(LEAST_SAMPLES, DENSER * max(tight.evaluations, decided.evaluations)))
    truth = float(sampled.min())
    # how deep bodies overlap is no matter: whatever is below 0 states nothing
    least = np.maximum(sampled, 0.0)
    wrong = []
    for name, check in (("tight", tight), ("decide", decided)):
        if not check.clearance <= least.min() + TOLERANCE:
            wrong.append(f"{name} bound {(check.clearance - least.min()) * 1e6:.1f} um above the truth")
        over = np.array(check.bounds) - least
        if not (over <= TOLERANCE).all():
            wrong.append(
                f"{name} bound of cubic {int(over.argmax())} {over.max() * 1e6:.1f} um above the truth"
            )
        if check.proved and truth < asked - TOLERANCE:
            wrong.append(f"{name} calls {truth * 1e3:.4f} mm enough for {asked * 1e3:.4f}")
        if not check.proved and truth > asked + UNDECIDED:
            wrong.append(f"{name} calls {truth * 1e3:.4f} mm too little for {asked * 1e3:.4f}")
    text = f"seed {seed} {' / '.join(case.kind)}: " + "; ".join(wrong) if wrong else ""
    if text:
        print(text, flush=True)
    return Result(
        case.kind,
        truth - asked,
        truth,
        truth - tight.clearance,
        text,
        decided.proved,
        (cpu[0], cpu[1], cpu[2]),
        (tight.evaluations, decided.evaluations, steps),
    )


def _sampled(case: Case) -> int:
    """Steps of `STEP` along the motion, to the first one that is too near."""
    control = case.curve.control
    # the most that a joint moves on each cubic is at most the way along its control points
    travel = np.abs(np.diff(control, axis=1)).sum(axis=1).max(axis=1)
    counts = np.maximum(1, np.ceil(travel / STEP).astype(int))
    looked = 0
    for i, count in enumerate(counts.tolist()):
        for q in place(case.curve, i + (np.arange(count) + 0.5) / count):
            looked += 1
            if case.world.in_collision(q, case.clearance):
                return looked
    return looked


def report(results: list[Result]) -> None:
    """Tables."""
    grazing = [r for r in results if NEAR[0] - 1e-4 <= r.off <= NEAR[1] + 1e-4]
    print(
        f"\n{len(results)} cases, {len(grazing)} graze; wrong: {sum(bool(r.wrong) for r in results)}; "
        f"proved in decide mode: {sum(r.proved for r in results)}"
    )
    print(
        "\n| group | cases | gap mm median | p95 | within 20 % or 1 mm |", "\n|---|---|---|---|---|", sep=""
    )
    clear = [r for r in results if r.truth > 0.0]
    groups = [("all that do not touch", clear), ("grazing", [r for r in grazing if r.truth > 0.0])]
    groups += [(name, [r for r in clear if name in r.kind]) for name in (*ARMS, *MOTIONS, *OBSTACLES)]
    for name, some in groups:
        if some:
            gaps = np.array([r.gap for r in some])
            near = np.mean([r.gap <= max(1e-3, 0.2 * r.truth) for r in some])
            print(
                f"| {name} | {len(some)} | {np.median(gaps) * 1e3:.2f} | {np.percentile(gaps, 95) * 1e3:.2f} "
                f"| {100 * near:.1f} % |"
            )
    print("\n| verdict | cases | mode | CPU ms median | mean | p95 | looked at, median | mean |")
    print("|---|---|---|---|---|---|---|---|")
    for verdict in (True, False):
        some = [r for r in results if r.proved == verdict]
        for index, mode in enumerate(("tight", "decide", f"sampling at {STEP:g} rad")):
            cpu = np.array([r.cpu[index] for r in some]) * 1e3
            looked = np.array([r.evaluations[index] for r in some])
            print(
                f"| {'proved' if verdict else 'refuted'} | {len(some)} | {mode} | {np.median(cpu):.2f} "
                f"| {cpu.mean():.2f} | {np.percentile(cpu, 95):.2f} | {np.median(looked):.0f} | {looked.mean():.1f} |"
            )
    proved = [r for r in results if r.proved]
    ratio = np.array([r.cpu[1] / r.cpu[2] for r in proved])
    total = sum(r.cpu[1] for r in proved) / sum(r.cpu[2] for r in proved)
    print(
        f"\nproved motions, decide over sampling: CPU {total:.2f} in all, {np.median(ratio):.2f} at the median"
    )
    off = Counter(" / ".join(r.kind[::2]) for r in results if r not in grazing)
    print("not grazing, by arm and body: " + ", ".join(f"{k} {n}" for k, n in off.most_common(6)))


if __name__ == "__main__":
    main()
