"""How much processor time do the error budget and the clearances with errors add to planning?

python bench/accuracy_cpu.py --plans 20

Tasks of `bench/draws.py` are planned in the cell of scenes/realistic. After each plan, the clearances of its moves with
the arm's errors and the budgets of its placements are computed, as `a465 plan` does. Processor time of this process,
each over that of planning the same task; the first task is computed twice, because it loads libraries. Where a cube
enters even with all errors five standard deviations large at once, its probability needs no samples. So budgets are
computed a second time with joints that err by 0.03 degrees at rest, where all need samples.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "support"))

from draws import draw_world
from run_conditions import run_conditions

from arm.errors import ImpossibleError
from arm.io.storage import data_file
from cell.accuracy.clearances import erring_clearances
from cell.accuracy.plan_budgets import require_placements
from cell.files.task import read_task
from cell.task.planning import Rest, plan_rest
from tasks.true_look import true_look
from typed.command_line import replace_in


def seconds_of(seed: int) -> list[float] | str:
    """Processor time of plan, clearances, budgets and uncertain budgets, s; or why there is no plan."""
    with tempfile.TemporaryDirectory() as folder:
        drawn = draw_world("task2", seed, data_file("scenes"), Path(folder))
        ideal, realistic = (str(data_file(f"scenes/{name}")) for name in ("cell.toml", "realistic/cell.toml"))
        replace_in(drawn.task, ideal, realistic)
        task = read_task(drawn.task)
        seen = true_look(task, drawn.world)
    erring = replace(task.cell, following_error=np.radians(0.03), least_insertion=0.0)
    clock = [time.process_time()]
    try:
        plan = plan_rest(Rest(task, seen, task.cell.q_start, 0.5))
        if plan is None:
            return f"{seed}: nothing to do"
        clock.append(time.process_time())
        erring_clearances(task.cell, plan, seen)
        clock.append(time.process_time())
        require_placements(task.cell, seen, plan)
        clock.append(time.process_time())
        require_placements(erring, seen, plan)
    except ImpossibleError as error:
        return f"{seed}: {error}"
    clock.append(time.process_time())
    found: list[float] = np.diff(clock).tolist()
    return found


def main() -> None:
    """Run, and print a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--plans", type=int, default=20)
    options = parser.parse_args()
    print(__doc__)
    print(f"{run_conditions()}; seeds from 0\n")
    seconds_of(0)
    found = [seconds_of(seed) for seed in range(options.plans)]
    for why in (of for of in found if isinstance(of, str)):
        print(f"left out, {why}\n")
    times = np.array([of for of in found if not isinstance(of, str)])
    shares = 100.0 * times[:, 1:] / times[:, :1]
    both, uncertain = shares[:, :2].sum(axis=1), shares[:, [0, 2]].sum(axis=1)
    print("| of planning | median | least | most |")
    print("|---|---|---|---|")
    rows = (
        ("clearances with errors", shares[:, 0]),
        ("budgets", shares[:, 1]),
        ("both", both),
        ("budgets with samples", shares[:, 2]),
        ("both, with samples", uncertain),
    )
    for name, of in rows:
        print(f"| {name} | {np.median(of):.1f} % | {of.min():.1f} % | {of.max():.1f} % |")
    print(f"\nplanning: median {1e3 * np.median(times[:, 0]):.0f} ms, {len(times)} tasks")


if __name__ == "__main__":
    main()
