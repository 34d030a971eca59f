"""Whole runs in random worlds of each task: how many place all four cubes, how accurately, and why others fail.

python bench/random_worlds.py --worlds 20
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from draws import draw_world

SCENES = Path(__file__).resolve().parents[1] / "scenes"


def main() -> None:
    """Draw, run, judge, print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--worlds", type=int, default=20, help="of each task")
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--time-scale", type=float, default=10.0)
    parser.add_argument("--tasks", nargs="+", default=["task1", "task2"], choices=["task1", "task2"])
    parser.add_argument("--keep", type=Path, help="folder for the runs; default: a temporary one")
    options = parser.parse_args()
    print(
        f"conditions: {options.worlds} worlds a task from seed {options.first_seed}; markers and cubes in view; "
        "every hole with an approach line in limits and clear of what stands; plate tops up to 0.15 m; "
        "tilts 0 (task 1) and 0, 7, 15 deg (task 2); noise 2 grey; speed of the cell file; "
        f"time scale {options.time_scale:g}"
    )
    with tempfile.TemporaryDirectory() as temporary:
        folder = options.keep or Path(temporary)
        for name in options.tasks:
            _campaign(name, options, folder)


def _campaign(name: str, options: argparse.Namespace, folder: Path) -> None:
    good, errors, tilts, clearances, seconds = 0, [], [], [], []
    for seed in range(options.first_seed, options.first_seed + options.worlds):
        drawn = draw_world(name, seed, SCENES, folder)
        began = time.monotonic()
        command = ["a465", "run", str(drawn.task), "--world", str(drawn.world), "--json"]
        command += ["--time-scale", str(options.time_scale), "-o", str(folder / f"{name}-{seed}")]
        ran = subprocess.run(
            [str(Path(sys.executable).with_name(command[0])), *command[1:]],
            capture_output=True,
            text=True,
            check=False,
        )
        seconds.append(time.monotonic() - began)
        report = json.loads(ran.stdout) if ran.stdout.strip() else {}
        cubes = report.get("cubes", [])
        placed = [c for c in cubes if c["placed"]]
        errors += [c["error_mm"] for c in placed]
        tilts += [c["tilt_error_deg"] for c in placed]
        clearances += [c["min_clearance_mm"] for c in placed]
        success = ran.returncode == 0 and len(placed) == 4
        good += success
        why = "" if success else " ".join(ran.stderr.strip().splitlines()[-1:])
        print(
            f"{name} seed {seed}: exit {ran.returncode}, {len(placed)} of 4 placed in {seconds[-1]:.0f} s {why}",
            flush=True,
        )
    print(f"{name}: all four cubes placed in {good} of {options.worlds} worlds")
    if errors:
        print(
            f"{name}: error mm median {np.median(errors):.2f}, worst {max(errors):.2f}; tilt deg median "
            f"{np.median(tilts):.3f}, worst {max(tilts):.3f}; smallest clearance {min(clearances):.1f} mm; "
            f"median wall time {np.median(seconds):.0f} s"
        )


if __name__ == "__main__":
    main()
