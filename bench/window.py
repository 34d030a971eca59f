"""A hand through a window: whether, and at which cost, a transit is found as the window gets narrower.

python bench/window.py

The hand is a box of 10 x 6 cm on the A465's flange. The wall is 20 mm thick at x = 0.42 m; its square window is centred
at z = 0.45 m. The tool goes from beside the wall to 100 mm behind it and points along +x; there the arm is nearly
folded, so it cannot simply draw the hand back. 5 mm are asked.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "tests" / "support"))

import numpy as np  # noqa: E402
from narrow_bench.conditions import conditions, timed  # noqa: E402
from narrow_bench.judge import Judge  # noqa: E402

from arm.errors import ImpossibleError  # noqa: E402
from plan.budget import SearchBudget, allowed  # noqa: E402
from plan.trajectory.time_estimates import path_time  # noqa: E402
from plan.transit.planner import plan_transit  # noqa: E402
from plans.transits import (  # noqa: E402
    LIMITS,
    WINDOW_START,
    arm_with_hand,
    through_window,
    wall_with_window,
)
from tasks.task2 import TABLE  # noqa: E402

CLEARANCE = 0.005  # m


def main() -> None:
    """Plan, judge, print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--sizes", type=float, nargs="+", default=[180.0, 170.0, 160.0, 150.0], help="mm")
    parser.add_argument("--seeds", type=int, default=20)
    options = parser.parse_args()
    print(conditions(f"windows of {options.sizes} mm, {options.seeds} seeds, {CLEARANCE * 1e3:g} mm asked"))
    print(
        "\n| window mm | queries | solved | CPU s median, max | effort s max | path s median | least distance mm |"
    )
    print("|---|---|---|---|---|---|---|")
    robot = arm_with_hand()
    for size in options.sizes:
        cpu, effort, times, least, queries = list[float](), list[float](), list[float](), np.inf, 0
        judge = Judge(robot, [TABLE, *wall_with_window(size / 1e3)])
        for seed in range(options.seeds):
            world, goals = through_window(robot, size / 1e3, CLEARANCE)
            for goal in goals:
                queries += 1
                with allowed(SearchBudget()) as meter, timed(cpu):
                    try:
                        path = plan_transit(world, WINDOW_START, goal, LIMITS, CLEARANCE, seed)
                    except ImpossibleError:
                        path = None
                effort.append(meter.effort_s)
                if path is not None:
                    times.append(path_time(path, LIMITS))
                    least = min(least, judge.least_distance(path))
        print(
            f"| {size:g} | {queries} | {len(times)} | {np.median(cpu):.2f}, {max(cpu):.2f} | {max(effort):.2f} "
            f"| {np.median(times):.1f} | {least * 1e3:.2f} |",
            flush=True,
        )


if __name__ == "__main__":
    main()
