"""Random walks of `a465 jog`: how near the arm comes to anything, and how soon it rests after the last key.

python bench/jog.py --walks 1000 --processes 2 -o bench/results/DATE-jog.json

Each walk is the session of the command with an emulated unit in stepped time: random keys that choose an axis and
change the step, and arrows that are pressed or held at 11 to 40 Hz. Every second walk starts up to 4 mm above the
clearance, the others up to 30 mm above it; with `--below`, all start between 1 mm and the clearance, as after a stop,
where only steps that lead away are made. Without a look, so the whole zone for boards is occupied. The verdict uses
the unit's own record of where the arm was, every 4 ms, and the exact distance of the nearest bodies there. A rest is
measured from the arrival of a key that no other follows within 0.6 s to the last ms in which the arm moved.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass
from functools import cache, partial
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "support"))

from run_conditions import run_conditions

from arm.io.storage import data_file
from cell.config.cell import Cell
from cell.config.cell_file import read_cell
from cell.scene.build import unseen_scene
from emulated.jogged import jogged_cell
from plan.collision.world import World

CELL = "scenes/cell.toml"
NEAR_M, FAR_M = 4e-3, 30e-3  # above the clearance, where walks start
BELOW_M = 1e-3  # least distance where walks start below the clearance
BURSTS = 12
APART_S = 0.6  # between the last key of a burst and the next
AXES = (b"1", b"2", b"3", b"4", b"5", b"6", b"x", b"y", b"z", b"a")
ARROWS = (b"\x1b[A", b"\x1b[B")
EACH_MS = 4  # of the record


@dataclass(frozen=True)
class Walk:
    """One walk.

    Attributes:
        seed: of start and keys.
        steps: number of steps sent.
        kept_off: messages that a step would come too near.
        least_mm: smallest distance of any two bodies on the way.
        start_mm: the same at the start.
        out: whether the clearance was kept at some time.
        fell_back: whether it was not kept later.
        rest_s: longest time from a last key until the arm rested.
        violations: of the protocol, by the unit.
    """

    seed: int
    steps: int
    kept_off: int
    least_mm: float
    start_mm: float
    out: bool
    fell_back: bool
    rest_s: float
    violations: int


@cache
def _cell() -> tuple[Cell, World]:
    cell = read_cell(data_file(CELL))
    scene = unseen_scene(cell)
    return cell, World(scene.robot_open, scene.present)


def walk(seed: int, below: bool = False) -> Walk:
    """Walk with random keys."""
    (cell, world), rng = _cell(), np.random.default_rng(seed)
    above = NEAR_M if seed % 2 else FAR_M
    low, high = (BELOW_M, cell.clearance) if below else (cell.clearance, cell.clearance + above)
    while True:
        q = rng.uniform(cell.limits.lower, cell.limits.upper)
        start = float(world.distance(q).value)
        if low < start < high:
            break
    ends: list[float] = []
    with jogged_cell(cell, unseen_scene(cell), np.degrees(q).tolist()) as jogged:
        at = jogged.clock.now() + 0.5
        for _ in range(BURSTS):
            jogged.press(at, AXES[rng.integers(len(AXES))])
            if rng.random() < 0.3:
                jogged.press(at + 0.01, (b",", b".")[rng.integers(2)])
            lasts, rate = rng.uniform(0.0, 2.5), rng.uniform(11, 40)
            at = jogged.hold(at + 0.05, ARROWS[rng.integers(2)], lasts, 1.0 / rate, rng.uniform(0.2, 0.5))
            if rng.random() < 0.3:  # the other way at once
                at = jogged.hold(at + rng.uniform(0.02, 0.4), ARROWS[rng.integers(2)], lasts, 1.0 / rate)
            ends.append(at)
            at += APART_S
        jogged.press(at + APART_S, b"q")
        jogged.keys_session.run()
        jogged.jog.finish()
        record, told = jogged.emulator.record(), jogged.heard.told
        violations = len(jogged.emulator.violations)
    moved_s = record.time_ms / 1e3
    rests = [
        float(moved_s[(moved_s > end) & (moved_s < end + APART_S)].max(initial=end)) - end for end in ends
    ]
    samples = cell.unit.positions(record.counts[::EACH_MS])
    clear = np.array([start, *(float(world.distance(one).value) for one in samples)])
    kept = np.flatnonzero(clear >= cell.clearance)
    fell_back = bool(len(kept)) and bool(clear[kept[0] :].min() < cell.clearance)
    kept_off = sum("comes within" in line or "inside" in line for line in told)
    least = 1e3 * float(clear.min())
    steps, rest_s = jogged.jog.steps, max(rests)
    return Walk(seed, steps, kept_off, least, 1e3 * start, bool(len(kept)), fell_back, rest_s, violations)


def main() -> None:
    """Walk, print the figures, and write them."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--walks", type=int, default=100)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--processes", type=int, default=1)
    parser.add_argument("--below", action="store_true")
    parser.add_argument("-o", "--output", type=Path)
    options = parser.parse_args()
    conditions, begun = run_conditions(), time.monotonic()
    print(conditions)
    with ProcessPoolExecutor(options.processes) as pool:
        seeds = range(options.seed, options.seed + options.walks)
        walks = list(pool.map(partial(walk, below=options.below), seeds))
    required = 1e3 * _cell()[0].clearance
    found = {
        "conditions": conditions,
        "walks": len(walks),
        "seed": options.seed,
        "steps": sum(w.steps for w in walks),
        "steps_kept_off": sum(w.kept_off for w in walks),
        "required_mm": required,
        "least_mm": round(min(w.least_mm for w in walks), 3),
        "below_required": sum(w.least_mm < required for w in walks),
        "nearer_than_start_by_0.1_mm": sum(w.least_mm < min(w.start_mm, required) - 0.1 for w in walks),
        "came_out": sum(w.out for w in walks),
        "fell_back": sum(w.fell_back for w in walks),
        "longest_rest_s": round(max(w.rest_s for w in walks), 3),
        "longer_than_0.4_s": sum(w.rest_s > 0.4 for w in walks),
        "violations": sum(w.violations for w in walks),
        "wall_s": round(time.monotonic() - begun),
    }
    print(json.dumps(found, indent=2))
    if options.output is not None:
        nearest = sorted(walks, key=lambda w: w.least_mm)[:10]
        slowest = sorted(walks, key=lambda w: -w.rest_s)[:10]
        found |= {"nearest": [asdict(w) for w in nearest], "slowest": [asdict(w) for w in slowest]}
        options.output.write_text(json.dumps(found, indent=2) + "\n")


if __name__ == "__main__":
    main()
