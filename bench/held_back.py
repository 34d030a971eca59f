"""By how much is the hand held back when a cube goes into its pocket, and when it stands on the rim?

python bench/held_back.py --runs 8

Contact physics without arm and camera, as bench/contact.py --alone: a cube is put into a drawn hole with the tool off
by an error along the plate, in a drawn direction, or with the plate lower or higher than the tool takes it to be. The
arm rests 0.5 s, then the jaws open. The distance by which contact holds the hand back along the tool is what counters
read at rest with `contact.servo_share` = 1. A cube is seated if the simulated cell says so after the jaws have opened.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np
from run_conditions import run_conditions

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "support"))

from arm.se3 import transform
from cell.scene.build import RELEASE_GAP
from emulated.driven_contact import LIFT, OVER, DrivenContact

ASIDE_MM = (0.0, 1.0, 2.0, 2.25, 2.5, 3.0, 4.0)
APPROACH_M_S = 0.04  # as planned at speed 0.5
HIGHER_MM = (-1.0, 0.5, 1.0, 1.5, 2.0)


def placed(rng: np.random.Generator, aside_mm: float, higher_mm: float) -> tuple[bool, float]:
    """Whether a cube is seated that was put down so, and how far the hand was held back before, mm."""
    driven, angle = DrivenContact(), rng.uniform(0.0, 2.0 * np.pi)
    driven.fetch(int(rng.integers(4)))
    error = (aside_mm * np.cos(angle), aside_mm * np.sin(angle), -higher_mm)
    off = transform(t=1e-3 * np.array(error) + (0.0, 0.0, RELEASE_GAP))
    goal = driven.T_base_hole(1, int(rng.integers(4))) @ off @ OVER
    driven.line(goal @ transform(t=(0.0, 0.0, -LIFT)))
    driven.line(goal, LIFT / APPROACH_M_S)
    driven.wait(0.5)
    driven.cell.catch_up()
    back = -1e3 * float(driven.cell._physics.pushed_back()[2])
    driven.jaws(0.0)
    return driven.cell.events[-1].what == "placed", back


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--runs", type=int, default=8, help="of each error")
    options = parser.parse_args()
    print(run_conditions(), flush=True)
    print(
        "| tool off by mm | plate higher by mm | seated | held back mm, seated | held back mm, not seated |"
    )
    print("|---|---|---|---|---|", flush=True)
    rng = np.random.default_rng(1)
    for aside, higher in [*((a, 0.0) for a in ASIDE_MM), *((0.5, h) for h in HIGHER_MM)]:
        found = [placed(rng, aside, higher) for _ in range(options.runs)]
        parts = ([back for seated, back in found if seated is which] for which in (True, False))
        words = [f"{min(part):.2f} to {max(part):.2f}" if part else "-" for part in parts]
        seated = sum(seated for seated, _ in found)
        print(f"| {aside:g} | {higher:g} | {seated} of {len(found)} | {' | '.join(words)} |", flush=True)


if __name__ == "__main__":
    main()
