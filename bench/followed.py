"""How far the tool, as it is sent, is from the lines of a drawing and from corners that may be rounded, at every ms.

python bench/followed.py
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "tests" / "support"))

from run_conditions import run_conditions  # noqa: E402

from arm.se3 import Array, inverse  # noqa: E402
from cell.program.outline import Outline, through  # noqa: E402
from cell.program.path_step import PathStep  # noqa: E402
from cell.program.planning import plan_of_program  # noqa: E402
from cell.program.program_file import ProgramTask, read_program  # noqa: E402
from programs.program_files import program  # noqa: E402
from vision.observation import Observation  # noqa: E402

TURNS_DEG, DEVIATIONS_MM = (30, 60, 90, 120, 150), (0.2, 0.3, 1.0, 3.0)
CORNER, SIDE = np.array([0.0, -150.0, 160.0]), 40.0  # mm, in the frame of the workpiece
CORNERED = """program = "a corner"
cell = "cell.toml"
clearance_mm = 6

[work]
origin_mm = [460, 0, 33]
rpy_deg = [0, 0, 180]

[[steps]]
name = "path"
points_mm = {points}
deviation_mm = {deviation}
axis = [0, 0, 1]
free = "rz"
tilt_deg = 30
"""


def sent(task: ProgramTask) -> dict[str, Array]:
    """Plan a program; return the tool's positions (n, 3) m in the frame of the workpiece, each ms of each path."""
    plan = plan_of_program(task, Observation(), task.cell.speed)
    robot, unit, T_work_base = task.cell.robot(), task.cell.unit, inverse(task.T_on_work)
    tools = {}
    for move in plan.moves:
        times = np.arange(0.0, move.path.duration_s, 1e-3)
        poses = [robot.T_base_tool(q) for q in unit.positions(move.path.at(times))]
        tools[move.name.removeprefix("along ")] = np.array([(T_work_base @ T)[:3, 3] for T in poses])
    return tools


def off_mm(outline: Outline, points: Array) -> float:
    """Largest distance of points (n, 3) m from an outline, mm."""
    return 1e3 * float(np.min([piece.distances(points) for piece in outline.pieces], axis=0).max())


def drawing() -> None:
    """Print how far the pen of the shipped drawing is from its rounded strokes."""
    task = read_program(ROOT / "scenes/pen/drawing.toml")
    tools = sent(task)
    print("\n| stroke of scenes/pen/drawing.toml | ms | off the line at most, mm |\n|---|---|---|")
    for step in task.steps:
        if isinstance(step, PathStep):
            tool = tools[step.name]
            print(f"| {step.name} | {len(tool)} | {off_mm(step.outline, tool):.4f} |")


def corners(folder: Path) -> None:
    """Print how far the tool is from two lines that meet in a corner, and how it passes the corner."""
    print(
        "\n| turn, deg | stated, mm | off the lines at most, mm | from the corner, mm | speed there, mm/s | within |"
    )
    print("|---|---|---|---|---|---|")
    for turn_deg in TURNS_DEG:
        turn = np.radians(turn_deg)
        end = CORNER + SIDE * np.array([np.sin(turn), 0.0, -np.cos(turn)])
        points = np.array([CORNER + [0.0, 0.0, SIDE], CORNER, end])
        for stated in DEVIATIONS_MM:
            (folder / f"{turn_deg} {stated}").mkdir()
            text = CORNERED.format(points=np.round(points, 6).tolist(), deviation=stated)
            tool = sent(read_program(program(folder / f"{turn_deg} {stated}", text)))["path"]
            off = off_mm(through(list(1e-3 * points)), tool)
            apart = 1e3 * np.linalg.norm(tool - 1e-3 * CORNER, axis=1)
            k = int(np.argmin(apart))
            speed = 1e6 * float(np.linalg.norm(tool[k + 1] - tool[k - 1])) / 2.0
            within = "yes" if max(off, apart[k]) <= stated else "NO"
            print(f"| {turn_deg} | {stated:g} | {off:.4f} | {apart[k]:.4f} | {speed:.1f} | {within} |")


def main() -> None:
    """Print the conditions and both tables."""
    print(run_conditions())
    drawing()
    with tempfile.TemporaryDirectory() as folder:
        corners(Path(folder))


if __name__ == "__main__":
    main()
