"""A board that slides after the cube was taken: is it told, and is the cube still seated?

python bench/second_look.py --runs 6              # every pair of runs takes some 50 s of processor time

Each run is `a465 run` on scenes/realistic with one cube, a seed of its own, and a target board that slides by 2 to 4 mm
in a drawn direction, and rotates by up to 1 degree, once the jaws have closed on the cube. The same run is done with
a second look at each placement (`look.second = "each"`) and without (`"never"`). Only the first release of the cube is
counted. With `--still`, the board stays, and what the second look costs is measured.

A cube is seated if the simulated cell's event says so: without contact physics, if it is released within the mouth.
"""

from __future__ import annotations

import argparse
import json
import shutil
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "support"))

from run_conditions import run_conditions

from arm.io.storage import data_file
from tasks.small import leave_cubes
from tasks.whole_run import run_whole
from typed.command_line import replace_in

LEAST_MM, MOST_MM, TURN_DEG = 2.0, 4.0, 1.0


@dataclass(frozen=True)
class Outcome:
    """One run: whether the motion was told before the release, the cube truly seated, how far off, and times."""

    told: bool
    hidden: bool
    seated: bool
    error_mm: float | None
    controller_s: float
    cpu_s: float


def run_of(seed: int, when: str, slides: bool) -> Outcome:
    """One run with its own seed and slide."""
    cv2.setNumThreads(1)
    rng, begin = np.random.default_rng(seed), time.process_time()
    by, azimuth = rng.uniform(LEAST_MM, MOST_MM), rng.uniform(0.0, 2.0 * np.pi)
    slid = [float(by * np.cos(azimuth)), float(by * np.sin(azimuth))] if slides else [0.0, 0.0]
    turn = float(rng.uniform(-TURN_DEG, TURN_DEG)) * slides
    hole = int(rng.integers(1, 5))
    with tempfile.TemporaryDirectory() as folder:
        scenes = Path(shutil.copytree(data_file("scenes"), Path(folder) / "scenes")) / "realistic"
        leave_cubes(scenes, int(rng.integers(1, 5)))
        world, cell = scenes / "task2.world.toml", scenes / "cell.toml"
        replace_in(world, "seed = 1 ", f"seed = {seed} ")
        keys = f"shifts_mm = {json.dumps(slid)}\nshifts_deg = {turn}"
        replace_in(world, "tilt_deg = 15", f"tilt_deg = 15\n{keys}")
        replace_in(scenes / "task2.toml", "to_board = [3, 4]", f"to_board = [3, 4]\nto_holes = [{hole}]")
        replace_in(cell, "[look]\n", f'[look]\nsecond = "{when}"\n')
        run = run_whole(scenes / "task2.toml", Path(folder) / "run")
    if run.simulated is None:
        raise ValueError(f"seed {seed}: {run.error}")
    released = [e.what for e in run.simulated.events if e.what in ("placed", "unseated", "fallen")]
    data = run.report or ({} if run.error is None else run.error.data)
    rows = data.get("cubes") or [{}]
    return Outcome(
        "board 03-04 has moved" in run.said.partition("released")[0],
        "does not show board" in run.said,
        released[:1] == ["placed"],
        rows[0].get("error_mm"),
        run.sent[-1][0] / 1e3,
        time.process_time() - begin,
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--runs", type=int, default=4)
    parser.add_argument("--first", type=int, default=1)
    parser.add_argument("--still", action="store_true", help="the board does not slide")
    options = parser.parse_args()
    print(run_conditions(), flush=True)
    print(
        "| seed | second look | told | hidden by the arm | seated at the first release | error mm | controller s |"
    )
    print("|---|---|---|---|---|---|---|", flush=True)
    sums: dict[str, list[Outcome]] = {"each": [], "never": []}
    for seed in range(options.first, options.first + options.runs):
        for when, found in sums.items():
            one = run_of(seed, when, not options.still)
            found.append(one)
            off = "-" if one.error_mm is None else f"{one.error_mm:.2f}"
            words = [("yes" if flag else "no") for flag in (one.told, one.hidden, one.seated)]
            print(f"| {seed} | {when} | {' | '.join(words)} | {off} | {one.controller_s:.1f} |", flush=True)
    for when, found in sums.items():
        print(
            f"{when}: {len(found)} runs, {sum(o.told for o in found)} told before the release, "
            f"{sum(o.hidden for o in found)} hidden, {sum(o.seated for o in found)} seated at the first release, "
            f"{sum(o.cpu_s for o in found):.0f} s of processor time"
        )


if __name__ == "__main__":
    main()
