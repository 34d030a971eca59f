"""Take images of the simulated cell, find boards and cubes, check reach, plan the whole task."""

from pathlib import Path

import numpy as np

from arm.io.storage import data_file
from cell.commands.steps import look_step
from cell.console import Console
from cell.files.observation import read_observation
from cell.files.task import read_task
from cell.scene.places import reach_of
from cell.task.planning import Rest, plan_rest

task_file = data_file("scenes/task2.toml")
look_step(task_file, None, None, Path("runs/example-look.json"), None, Console())

task = read_task(task_file)
seen = read_observation(Path("runs/example-look.json"), task.cell)
table = reach_of(task, seen)
table.require()
print(
    "least margin to a joint limit:",
    round(min(float(np.degrees(h.best.margin)) for h in table.holes), 1),
    "deg",
)

plan = plan_rest(Rest(task, seen, task.cell.q_start, speed=0.5))
if plan is not None:
    print(f"{len(list(plan.moves))} moves, {plan.duration_s:.1f} s, plan {plan.sha256[:12]}")
    print(f"smallest certified clearance {1e3 * min(m.clearance for m in plan.moves):.1f} mm")
