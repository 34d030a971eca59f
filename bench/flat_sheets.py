"""Camera calibration from a sheet that lies flat: are the focal length's standard deviation and interval honest?

python bench/flat_sheets.py --runs 50

A ChArUco sheet 5 x 5 of 25 mm lies anywhere on a table 1.19 m under a camera of 1920 x 1200 px, f 4740 px, k1 -0.25,
that is tilted by some 2 deg; 15 views. Errors, standard deviations: corners 0.15 px common to all views and 0.05 px
each; paper 0.2 mm per bulge, common and again of each view; rows against columns 0.2 %. With --lift-mm one view is on a
box. NEES: mean of (error / standard deviation)^2 of fx; 1 is honest.
"""

from __future__ import annotations

import argparse
import sys
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "support"))

from calib.camera.flat_views import FlatViews, Lift
from calib.model.intrinsics import vector_of
from recorded.flat_targets import F_PX, FLAT, SIZE, flat_views

VIEWS = 15


def run(seed: int, lift: float) -> tuple[int, float, float, float, float]:
    """Seed, fx, its standard deviation, and the ends of its interval, px."""
    views = flat_views(seed, VIEWS, (lift,))
    lifts = [Lift(lift) if lift else None] + [None] * (VIEWS - 1)
    flat = FlatViews(views, FLAT, SIZE, lifts).solve()
    return seed, float(vector_of(flat.camera)[0]), float(np.sqrt(flat.covariance[0, 0])), *flat.interval


def main() -> None:
    """Run and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=50)
    parser.add_argument("--first", type=int, default=100, help="seed of the first run")
    parser.add_argument("--lift-mm", type=float, default=0.0)
    parser.add_argument("--workers", type=int, default=2)
    args = parser.parse_args()
    scores, inside, relative = [], 0, []
    with ProcessPoolExecutor(args.workers) as pool:
        seeds = range(args.first, args.first + args.runs)
        for seed, fx, sd, low, high in pool.map(partial(run, lift=args.lift_mm / 1e3), seeds):
            scores.append((fx - F_PX) / sd)
            relative.append(sd / F_PX)
            inside += low < F_PX < high
            print(f"seed {seed}: fx {fx:.0f} +- {sd:.0f} px, 95 % {low:.0f} to {high:.0f}", flush=True)
    z = np.array(scores)
    print(f"{len(z)} sets: NEES {np.mean(z**2):.2f}, mean score {z.mean():+.2f}, worst {np.abs(z).max():.2f}")
    print(
        f"interval holds the truth in {inside}; standard deviation {100 * np.median(relative):.1f} % (median)"
    )


if __name__ == "__main__":
    main()
