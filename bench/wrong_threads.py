"""Motions of a threaded ring that are wrong on purpose: does `a465 check` accept one?

python bench/wrong_threads.py --wrong 500

Half of them leave the wire over its free end and come down beside it (every other one goes back and on again); the
others pass through the bar, run beside the wire, graze it, and so on (`bench/hoop_bench/wrong_motions.py`). Each is put
into the plan of its program in place of the way along the wire, states that it is threaded and keeps the clearance that
the program asks for, and is given to the function of `a465 check`. In one kind the plan does not state `threaded`.

`bench/hoop_bench/thread_oracle.py` says, apart from planner and certificate, which of them are wrong: those with
another linking number than 1 or -1 somewhere, or with 0.1 mm less than the clearance at a sample. Those with 0.1 mm
more, and threaded, are right; the certificate may refuse them. "Only the ray": wrong motions that keep the clearance
from all bodies, so that only the linking number and the ray tell that they are wrong.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections import Counter
from pathlib import Path

import numpy as np
from hoop_bench.wrong_motions import (
    OTHERS,
    Maker,
    Right,
    Rng,
    other_wire,
    over_the_end,
    plan_with,
    right_motion,
)
from run_conditions import run_conditions

from arm.errors import A465Error
from cell.program.program_file import read_program
from cell.task.plan_matches import check_plan

SCENES = Path(__file__).resolve().parents[1] / "scenes" / "hoop"
UNDECIDED = 1e-4  # m, to which the oracle's meshes and samples are good
OVER, UNSTATED = "over the free end", "over the free end, not stated as threaded"


class Tally:
    """What came of the motions of one kind."""

    def __init__(self) -> None:
        self.counts: Counter[str] = Counter()
        self.accepted: list[str] = []


def tried(of: Right, q: np.ndarray, stated: str | None, tally: Tally) -> bool:
    """Judge a motion and check it; return whether it is wrong."""
    required = of.task.required
    judged = of.oracle.judge(q, required)
    wrong = not judged.linked or judged.least < required - UNDECIDED
    right = judged.linked and judged.least > required + UNDECIDED
    kind = "wrong" if wrong else "right" if right else "undecided"
    try:
        check_plan(of.task, plan_with(of, q, stated))
        accepted = True
    except A465Error:
        accepted = False
    tally.counts[kind] += 1
    tally.counts[f"{kind} accepted"] += accepted
    tally.counts["only the ray"] += wrong and judged.bodies >= required + UNDECIDED
    if wrong and accepted:
        tally.accepted.append(
            f"{of.wire}: linked {judged.linked}; {1e3 * judged.bodies:.2f} mm between {judged.pair}"
        )
    return wrong


def main() -> None:
    """Make, judge, check, print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--wrong", type=int, default=500, help="wrong motions of each half")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--kinds", nargs="*", help="only these kinds, as the table names them")
    asked = parser.parse_args()
    begin = time.process_time()
    every = [right_motion(read_program(SCENES / f"{wire}.toml")) for wire in "abcde"]

    def of_another_wire(of: Right, rng: Rng) -> np.ndarray | None:
        return other_wire(of, rng, every)

    columns = (
        "wrong",
        "wrong accepted",
        "only the ray",
        "right",
        "right accepted",
        "undecided",
        "undecided accepted",
    )
    print(
        f"{run_conditions()}; seed {asked.seed}\n\n| kind | {' | '.join(columns)} |\n|---|{'---|' * len(columns)}"
    )

    def print_row(kind: str, counts: Counter[str]) -> None:
        print(f"| {kind} | {' | '.join(str(counts[c]) for c in columns)} |", flush=True)

    rng, tallies = np.random.default_rng(asked.seed), {"unchanged": Tally()}
    for of in every:
        tried(of, np.concatenate([of.q, of.q[-2::-1]]), of.wire, tallies["unchanged"])
    print_row("unchanged", tallies["unchanged"].counts)
    others: dict[str, Maker] = {**OTHERS, "another wire's": of_another_wire, UNSTATED: over_the_end}
    for half in ({OVER: over_the_end}, others):
        for number, (kind, make) in enumerate(half.items()):
            if asked.kinds and kind not in asked.kinds:
                continue
            wanted = asked.wrong // len(half) + (number < asked.wrong % len(half))
            tally = tallies.setdefault(kind, Tally())
            while tally.counts["wrong"] < wanted:
                of = every[int(rng.integers(len(every)))]
                q = make(of, rng)
                if q is not None:
                    tried(of, q, None if kind == UNSTATED else of.wire, tally)
                    print(f"\r{kind} {tally.counts['wrong']}   ", end="", file=sys.stderr)
            print_row(kind, tally.counts)
    print_row("all", sum((tally.counts for tally in tallies.values()), Counter[str]()))
    print(f"\n{time.process_time() - begin:.0f} s of CPU")
    for kind, tally in tallies.items():
        for line in tally.accepted:
            print(f"- {kind}: {line}")


if __name__ == "__main__":
    main()
