"""Calibrate a second of effort: collision checks of refused searches against CPU time.

python bench/budget.py
"""

from __future__ import annotations

import os
import platform
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "tests" / "support"))

from arm.controller.unit import load_unit  # noqa: E402
from arm.errors import ImpossibleError  # noqa: E402
from arm.robot.model import load_a465  # noqa: E402
from arm.robot.shapes import Body, Box  # noqa: E402
from arm.se3 import rot_x, transform  # noqa: E402
from plan.budget import CHECKS_PER_SECOND, allowed  # noqa: E402
from plan.options import PlanOptions  # noqa: E402
from plan.program.goals.target import Target  # noqa: E402
from plan.program.pose_lists import plan_poses  # noqa: E402
from plan.program.tasks import plan_task  # noqa: E402
from tasks.task2 import Q_START, task2  # noqa: E402

SEEDS = 4


def refused(seed: int) -> tuple[str, Callable[[], object]]:
    """A search that finds nothing: walls around the arm, or a wall between two boards."""
    rng = np.random.default_rng(seed)
    unit = load_unit("crs93")
    if seed % 2 == 0:
        cage = [
            Body("wall", Box((0.9, 0.02, 1.0)), transform(t=(0.58, rng.uniform(-0.03, 0.03), 0.45)), "wall"),
            Body("back", Box((0.9, 0.02, 1.0)), transform(t=(-0.58, 0.0, 0.45)), "wall"),
            Body("lid", Box((2.0, 2.0, 0.02)), transform(t=(0.0, 0.0, 0.7)), "wall"),
        ]
        robot = load_a465(0.134112, 0.06)
        target = Target("other side", transform(rot_x(np.pi), (0.3, 0.35, 0.2)))
        start = np.radians([-60, -35, -85, 0, -60, 0])
        return "list", lambda: plan_poses(
            robot, cage, [target], start, unit.limits(), options=PlanOptions(speed=1.0, seed=seed)
        )
    case = task2()
    wall = Body("wall", Box((2.6, 0.02, 2.4)), transform(t=(1.42, 0.0, 1.2)), "wall")
    behind = Body("behind", Box((2.6, 0.02, 2.4)), transform(t=(-1.42, 0.0, 1.2)), "wall")
    scene = case.scene.__class__(
        case.scene.robot_open,
        case.scene.robot_holding,
        (*case.scene.bodies, wall, behind),
        case.scene.cubes,
        case.scene.allowed,
    )
    return "task", lambda: plan_task(scene, case.transfers, Q_START, unit, options=PlanOptions(seed=seed))


def main() -> None:
    """Run each, print collision checks, time and their quotient."""
    print(
        f"conditions: Python {platform.python_version()}, {os.cpu_count()} processors, load {os.getloadavg()[0]:.1f}; "
        f"process time; {CHECKS_PER_SECOND:g} collision checks a second of effort"
    )
    for seed in range(SEEDS):
        kind, search = refused(seed)
        began = time.process_time()
        with allowed(None) as meter:
            try:
                search()
                end = "planned"
            except ImpossibleError as error:
                end = str(error)[:60]
        spent = time.process_time() - began
        print(
            f"{kind} {seed}: {spent:.1f} s, {meter.checks:.0f} collision checks, {meter.checks / spent:.0f}/s, "
            f"{meter.effort_s / spent:.2f} s of effort a second; {end}",
            flush=True,
        )


if __name__ == "__main__":
    main()
