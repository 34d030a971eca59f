"""A small pallet: boxes from one place onto a grid, in the cell of scenes."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from arm.io.storage import data_file
from arm.plan_file import Plan
from cell.program.program_file import ProgramTask
from plan.collision.world import distance_of
from plan.scene import scene_from_json
from plan.verify import scenes_of_moves

TEXT = """program = "a small pallet"
cell = "CELL"
clearance_mm = 5
part.box_mm = [44, 44, 36]

[work]
origin_mm = [420, -60, 0]

[[steps]]
name = "take"
at_mm = [60, 230, 18]
free = "rz"
approach_mm = 60
retract_mm = 60
jaws = "close"
part = "take"

[[steps]]
name = "put"
at_mm = [0, 0, 18]
grid.count = [1, 2, 2]
grid.step_mm = [70, 52, 36]
free = "rz"
approach_mm = 60
retract_mm = 60
jaws = "open"
part = "put"
"""


def pallet(folder: Path, *replaced: tuple[str, str]) -> Path:
    """Write the program into a folder, with texts replaced, and its world; return its file."""
    text = TEXT.replace("CELL", str(data_file("scenes/cell.toml")))
    for old, new in replaced:
        if old not in text:
            raise ValueError(f"the pallet does not have {old!r}")
        text = text.replace(old, new)
    file = folder / "pallet.toml"
    file.write_text(text)
    file.with_name("pallet.world.toml").write_text("boards = []\n")
    return file


def samples_of_parts(task: ProgramTask, plan: Plan, every_s: float = 4e-3) -> dict[str, float]:
    """Least distance of the held part from all that stands, by coal at samples, m: on lines but what may touch."""
    unit, robot = task.cell.unit, task.cell.robot()
    scene = scene_from_json(plan.scene, robot, task.cell.robot_holding())
    least = {"transit": np.inf, "line": np.inf}
    for of in scenes_of_moves(plan, scene, unit):
        if of.held is None:
            continue
        body, T_tool_held = of.held
        line = of.move.role in ("approach", "retract")
        may_touch = set(of.move.allowed_collisions) if line else set[str]()
        for q in unit.positions(of.move.path.at(np.arange(0.0, of.move.path.duration_s, every_s))):
            at = body.at(robot.T_base_tool(q) @ T_tool_held)
            for other in (*scene.bodies, *of.resting):
                if other.name not in may_touch:
                    kind = "line" if line else "transit"
                    least[kind] = min(least[kind], distance_of(at, other).value)
    return least
