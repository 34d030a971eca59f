"""Motions of arms that err: how often is the proved clearance violated, with and without the errors taken off?

python bench/arm_errors.py --plans 20 --arms 20

Tasks of `bench/draws.py` are planned in the cell of scenes/realistic. Every move is certified twice, to 5 % or 0.5 mm:
for an exact arm, and for one whose joints err by up to k standard deviations (`cell.accuracy.arm_errors`). Then arms
are drawn from the calibration's covariance, with the scatter of the joints at one arrival, and each executes the move
as it is sent. Its smallest distance, at steps of 0.01 rad and finer about the closest one, is compared with both
clearances. A motion that comes nearer by more than 20 um, the error of computed distances, violates a certificate.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "support"))

from draws import draw_world
from run_conditions import run_conditions

from arm.errors import ImpossibleError
from arm.io.storage import data_file
from arm.plan_file import Move
from arm.se3 import Array
from cell.accuracy.arm_errors import arm_errors
from cell.config.cell import Cell
from cell.files.task import read_task
from cell.task.plan_matches import scene_of_now
from cell.task.planning import Rest, plan_rest
from plan.collision.certificate import certify_move
from plan.collision.world import World
from plan.verify import move_scenes
from tasks.true_look import true_look
from typed.command_line import replace_in

STEP, FINER = 0.01, 12  # rad of the joint that moves most, and samples between two of these
EXACT = 2e-5  # m: of computed distances


@dataclass(frozen=True)
class Motions:
    """Motions of one plan.

    Attributes:
        count: moves times arms.
        nearer, nearer_than_erring: how many came nearer than the clearance of the exact arm, and of the erring one.
        worst: how much nearer than the clearance of the exact arm and of the erring one, m; negative if none was.
        taken: what the errors took off the clearance of each move, m.
        cpu_s: of the certificates of the exact arm, and of the erring one.
    """

    count: int
    nearer: int
    nearer_than_erring: int
    worst: tuple[float, float]
    taken: tuple[float, ...]
    cpu_s: tuple[float, float]


def motions_of(arms: int, seed: int) -> Motions | str:
    """Plan, certify and draw; or why there is no plan."""
    with tempfile.TemporaryDirectory() as folder:
        drawn = draw_world("task2", seed, data_file("scenes"), Path(folder))
        replace_in(
            drawn.task, str(data_file("scenes/cell.toml")), str(data_file("scenes/realistic/cell.toml"))
        )
        task = read_task(drawn.task)
        try:
            plan = plan_rest(Rest(task, true_look(task, drawn.world), task.cell.q_start, 0.5))
        except ImpossibleError as error:
            return f"{seed}: {error}"
        if plan is None:
            return f"{seed}: nothing to do"
        scene = scene_of_now(task, plan)
    errors = arm_errors(task.cell)
    if errors is None:
        raise ValueError("the cell is not calibrated")
    rng = np.random.default_rng(seed)
    root = np.linalg.cholesky(errors.covariance)
    off, taken, cpu = [], [], np.zeros(2)
    for move, world, _ in move_scenes(plan, scene, task.cell.unit):
        certificates = []
        for which, of in enumerate((None, errors)):
            begin = time.process_time()
            certificates.append(certify_move(world, move.path, task.cell.unit, 0.0, errors=of))
            cpu[which] += time.process_time() - begin
        taken.append(certificates[0].clearance - certificates[1].clearance)
        for _ in range(arms):
            least = _least(task.cell, world, move, root @ rng.standard_normal(6))
            off.append([c.clearance - least for c in certificates])
    nearer = np.array(off)
    exact, erring = (nearer > EXACT).sum(axis=0).tolist()
    worst, used = nearer.max(axis=0).tolist(), cpu.tolist()
    return Motions(len(nearer), exact, erring, (worst[0], worst[1]), tuple(taken), (used[0], used[1]))


def _least(cell: Cell, world: World, move: Move, error: Array) -> float:
    """Smallest distance of a move of an arm whose joints are off by `error` (6,) rad, m."""
    coarse = np.linspace(0.0, move.path.duration_s, max(3, int(_travel(cell, move) / STEP)))
    distances = [world.distance(q + error).value for q in cell.unit.positions(move.path.at(coarse))]
    closest = int(np.argmin(distances))
    low, high = coarse[max(closest - 1, 0)], coarse[min(closest + 1, len(coarse) - 1)]
    fine = cell.unit.positions(move.path.at(np.linspace(low, high, FINER)))
    return min(*distances, *(world.distance(q + error).value for q in fine))


def _travel(cell: Cell, move: Move) -> float:
    knots = cell.unit.positions(move.path.knots())
    return float(np.abs(np.diff(knots, axis=0)).sum(axis=0).max())


def main() -> None:
    """Run, and print a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--plans", type=int, default=20)
    parser.add_argument("--arms", type=int, default=20, help="drawn for every move")
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=1)
    options = parser.parse_args()
    print(__doc__)
    print(f"{run_conditions()}; seeds from {options.first_seed}\n")
    done: list[Motions] = []
    seeds = range(options.first_seed, options.first_seed + options.plans)
    with ProcessPoolExecutor(options.jobs) as pool:
        for found in pool.map(partial(motions_of, options.arms), seeds):
            if isinstance(found, str):
                print(f"no plan, {found}", flush=True)
            else:
                done.append(found)
    count = sum(of.count for of in done)
    print("| certificate | motions | nearer than proved | share | worst, um | CPU of all certificates, s |")
    print("|---|---|---|---|---|---|")
    for which, name in enumerate(("of an exact arm", "of an arm with its errors")):
        nearer = sum((of.nearer, of.nearer_than_erring)[which] for of in done)
        worst, cpu = 1e6 * max(of.worst[which] for of in done), sum(of.cpu_s[which] for of in done)
        print(f"| {name} | {count} | {nearer} | {100.0 * nearer / count:.2f} % | {worst:.0f} | {cpu:.1f} |")
    taken = 1e3 * np.concatenate([of.taken for of in done])
    print(f"\ntaken off a move's clearance: median {np.median(taken):.2f} mm, at most {taken.max():.2f} mm")


if __name__ == "__main__":
    main()
