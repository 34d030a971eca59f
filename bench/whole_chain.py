"""The whole chain in drawn worlds: where cubes are released, against the linear bound of the same worlds.

python bench/whole_chain.py --worlds 60

In each world a lens is calibrated from 20 views, then camera and arm from 24 planned poses, each by a465 and with the
result of the step before, read back from its files. Two boards anywhere in view and reach, up to 0.15 m high and tilted
by 0, 7 or 15 degrees, are seen in five images; the planner plans all four cubes, and the arm's true position at the
counts of each release is compared with the hole's true axis. Corners have 0.1 to 0.3 px of noise in all steps, 0.04 px
that all corners of an image share (what is left of the camera's sway: `bench/real_cell.py`). The target's print is off
by 0.1 % and its corners by 0.1 px inwards or outwards, markers and holes of the boards by 0.1 mm in each direction (CSV
within 0.2 mm), all standard deviations. Zeros of J2 to J5 are off by up to 0.3 degrees. "arm repeats": nothing else.
"arm errs": it also scatters by 0.002 to 0.02 degrees, its gears run out of true by 0.01 degrees, and its links sag by
up to 0.03 degrees.

The bound is the covariance of the best estimator, linearised at the truth, with the sizes of all errors known; "by
chance" is what 95 % of campaigns as large as this one would print at the bound.
"""

from __future__ import annotations

import argparse
import os
import platform
import sys
import tempfile
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "support"))

from whole_chain_bench.bound import placement_bound
from whole_chain_bench.world import Refused, drawn, placed

from arm.se3 import Array

CAMPAIGNS = 2000


@dataclass(frozen=True, eq=False)
class Row:
    """A world's outcome: offsets (n, 2) m and their bound (2 n, 2 n), or why it was refused."""

    seed: int
    refused: str
    off: Array
    bound: Array


def one(real: bool, seed: int) -> Row:
    """Run a world."""
    world = drawn(seed, real)
    try:
        with tempfile.TemporaryDirectory() as folder:
            found = placed(world, Path(folder))
    except Refused as why:
        return Row(seed, str(why), np.zeros((0, 2)), np.zeros((0, 0)))
    return Row(seed, "", np.array([cube.off for cube in found.cubes]), placement_bound(world, found))


def main() -> None:
    """Run, and print a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--worlds", type=int, default=60, help="of each arm")
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--arms", nargs="+", choices=["repeats", "errs"], default=["repeats", "errs"])
    options = parser.parse_args()
    print(__doc__.split("\n\n", 2)[2].strip())
    print(
        f"{options.worlds} worlds from seed {options.first_seed}, Python {platform.python_version()}, "
        f"numpy {np.__version__}, {os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}\n"
    )
    seeds = range(options.first_seed, options.first_seed + options.worlds)
    for arm in options.arms:
        began = time.monotonic()
        with ProcessPoolExecutor(options.jobs) as pool:
            rows = list(pool.map(partial(one, arm == "errs"), seeds))
        _table(arm, rows)
        print(f"{time.monotonic() - began:.0f} s\n", flush=True)


def _table(arm: str, rows: list[Row]) -> None:
    done = [row for row in rows if not row.refused]
    for row in rows:
        if row.refused:
            print(f"  world {row.seed} refused: {row.refused}")
    print(f"arm {arm}: {len(done)} of {len(rows)} worlds planned, {sum(len(r.off) for r in done)} cubes")
    if not done:
        return
    off = 1e3 * np.concatenate([np.linalg.norm(r.off, axis=1) for r in done])
    simulated = _campaigns(done)
    nees = [float(r.off.ravel() @ np.linalg.solve(r.bound, r.off.ravel())) / r.off.size for r in done]
    print(f"{'':18}{'measured':>10}{'bound':>8}{'ratio':>7}   by chance")
    for name, of in (("median", 50), ("95th percentile", 95)):
        measured, at_bound = float(np.percentile(off, of)), np.percentile(simulated, of, axis=1)
        low, high = np.percentile(at_bound, [2.5, 97.5])
        expected = float(np.percentile(simulated, of))
        print(
            f"{name:18}{measured:7.3f} mm{expected:8.3f}{measured / expected:7.2f}   {low:.3f} to {high:.3f}"
        )
    print(f"{'worst':18}{off.max():7.3f} mm")
    print(f"squared errors over the bound's covariance, per direction: {np.mean(nees):.2f}")


def _campaigns(rows: list[Row]) -> Array:
    """Offsets of campaigns at the bound, (campaigns, cubes) mm."""
    rng = np.random.default_rng(0)
    parts = []
    for row in rows:
        drawn_off = rng.multivariate_normal(np.zeros(len(row.bound)), row.bound, CAMPAIGNS)
        parts.append(1e3 * np.linalg.norm(drawn_off.reshape(CAMPAIGNS, -1, 2), axis=2))
    return np.concatenate(parts, axis=1)


if __name__ == "__main__":
    main()
