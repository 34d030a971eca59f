"""Distances of tori against coal's of many capsules, proofs of a ring on a bar against samples, and what both cost.

python bench/torus.py [--pairs 1000] [--motions 300]
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "tests" / "support"))

from run_conditions import run_conditions  # noqa: E402

from arm.robot.shapes import Body, Torus  # noqa: E402
from arm.se3 import rotation, transform  # noqa: E402
from arms.around import KINDS  # noqa: E402
from arms.grazing import obstacle  # noqa: E402
from arms.hoop import (  # noqa: E402
    THREADED,
    along_bar,
    as_capsules,
    bar,
    hoop_arm,
    joints,
    motion,
    sampled,
    threaded,
)
from plan.collision.certificate import certify_curve  # noqa: E402
from plan.collision.world import World, distance_of  # noqa: E402
from tasks.task2 import TABLE  # noqa: E402

CAPSULES = 720  # that stand for a torus
ASKED = 0.002  # clearance, m
SERIES = 5  # of each measurement, the fastest counts


def differences(count: int) -> None:
    """Print how far distances are from coal's, beyond what the capsules differ from a torus."""
    rng, others = np.random.default_rng(0), [kind for kind in KINDS if kind != "torus"]
    beyond, apart, wrong = [], 0, 0
    for i in range(count):
        shape = Torus(float(rng.uniform(0.02, 0.1)), float(rng.uniform(0.003, 0.015)))
        reach = rng.choice([0.01, 0.1, 0.3])
        place = [transform(rotation(rng.normal(size=3)), rng.uniform(-reach, reach, 3)) for _ in range(2)]
        torus = Body("torus", shape, place[0], "tool")
        other = Body("other", obstacle(others[i % len(others)], rng), place[1], "wall")
        ours = distance_of(torus, other).value
        theirs = min(distance_of(part, other).value for part in as_capsules(torus, CAPSULES))
        wrong += (ours < 0.0) != (theirs < 0.0)
        if theirs > 0.0:
            apart += 1
            beyond.append(abs(ours - theirs) - shape.radius * (np.pi / CAPSULES) ** 2 / 4.0)
    print(
        f"{count} pairs, {apart} apart: at most {1e6 * max(0.0, *beyond):.2f} um beyond that, wrong signs {wrong}"
    )


def attacked(count: int) -> None:
    """Print how many proofs of random motions of a ring on a bar samples contradict, and how tight they are."""
    rng, world, wrong, proved, gaps = np.random.default_rng(1), threaded(bar((0.002, -0.003))), 0, 0, []
    for _ in range(count):
        curve = motion(rng)
        least = sampled(world, curve)
        tight, decided = certify_curve(world, curve, ASKED, True), certify_curve(world, curve, ASKED)
        wrong += tight.clearance > least + 1e-6 or decided.proved != tight.proved
        wrong += decided.proved and least < ASKED - 1e-6
        proved += decided.proved
        if least > 0.0:
            gaps.append(least - tight.clearance)
    print(
        f"{count} motions of a ring on a bar, samples at 0.002 rad: wrong {wrong}, proved {proved}, "
        f"gap {1e3 * np.median(gaps):.2f} mm median, {1e3 * max(gaps):.2f} mm at most"
    )


def microseconds(work: Callable[[], object], count: int = 1) -> float:
    """Return the processor time of one of `count` things that are done at once."""
    work()
    least = np.inf
    for _ in range(SERIES):
        began = time.process_time()
        work()
        least = min(least, time.process_time() - began)
    return float(1e6 * least / count)


def costs() -> None:
    """Print what a ring costs on a bar of six boxes, with and without it."""
    with_ring = threaded(bar((0.004, 0.002)))
    bare = replace(hoop_arm(), bodies=tuple(body for body in hoop_arm().bodies if body.name != "ring"))
    without = World(bare, [TABLE, *bar((0.004, 0.002))])
    rng, q, curve = np.random.default_rng(2), joints(THREADED), along_bar(0.2)
    qs = {"near the bar's axis": 0.01, "half of them touching": 0.05}
    print("| us of processor time | with the ring | without |")
    print("|---|---|---|")
    rows: dict[str, Callable[[World], float]] = {
        "`World.distance`": lambda world: microseconds(lambda: [world.distance(q) for _ in range(50)], 50),
        "`World.near`, each of 60": lambda world: microseconds(lambda: world.near(some, 0.02), 60),
    }
    some = q + 0.01 * rng.normal(size=(60, 6))
    for name, spread in qs.items():
        many = q + spread * rng.normal(size=(1000, 6))
        rows[f"`World.too_near`, {name}"] = lambda world, many=many: microseconds(  # type: ignore[misc]
            lambda: [world.too_near(0.003)(q) for q in many], 1000
        )
    for asked in (0.003, 0.012):
        rows[f"certificate along 0.2 m of the bar, {1e3 * asked:g} mm asked"] = (
            lambda world, asked=asked: microseconds(lambda: certify_curve(world, curve, asked))  # type: ignore[misc]
        )
    rows["the same, tight"] = lambda world: microseconds(lambda: certify_curve(world, curve, 0.003, True))
    for name, cost in rows.items():
        print(f"| {name} | {cost(with_ring):.0f} | {cost(without):.0f} |", flush=True)


def main() -> None:
    """Run all three."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--pairs", type=int, default=1000)
    parser.add_argument("--motions", type=int, default=300)
    asked = parser.parse_args()
    print(f"conditions: {run_conditions()}; {CAPSULES} capsules for a torus; fastest of {SERIES} series")
    costs()
    attacked(asked.motions)
    differences(asked.pairs)


if __name__ == "__main__":
    main()
