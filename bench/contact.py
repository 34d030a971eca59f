"""Whole runs with contact physics, the tool off by some mm over the target board: how many cubes are seated?

python bench/contact.py --runs 25 --errors 0 1 2 3

Every run is `a465 run scenes/task2.toml --cell mujoco`; without recovery with half as many pixels along rows and
columns. Over the board that holds the cubes the true tool is where the arm reads. Over the other one it is off by the
error, along the board, in a direction drawn for each run; in between the error grows as the tool goes from one board to
the other. So a cube is gripped well and placed badly, and images show the truth. A cube is seated if
`cell.contact.resting` says so at the end;
"told" is what the run said. Without recovery no look comes before all cubes have been released, because a run ends at
the first that is not seated. CPU and steps are means of a run. CPU is process time, with planning, images and unit.
With --alone neither arm nor camera nor unit takes part: the tool carries one cube at a time on straight lines, from a
hole to a hole, both drawn, and is off at the second. With --lean it leans there instead, about the hole's middle.
"""

from __future__ import annotations

import argparse
import io
import shutil
import sys
import tempfile
import time
from collections import Counter
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass
from pathlib import Path
from unittest.mock import patch

import numpy as np
import numpy.typing as npt
from run_conditions import run_conditions

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "support"))

import cell.session.connection
from arm.board import PLATE_CENTRE
from arm.errors import A465Error
from arm.io.storage import data_file
from arm.se3 import Array, apply, transform
from cell.commands.run import run_task
from cell.console import Console
from cell.contact.cell import ContactCell
from cell.contact.resting import resting
from cell.files.task import Task, read_task
from cell.files.world import read_world
from cell.session.connection import WhichCell, world_file
from emulated.driven_contact import DrivenContact, world_of
from tasks.small import small_scenes
from typed.command_line import replace_in

ZONE = (0.42, 0.54)  # of the way from one board's centre to the other's, in which the error grows
FROM, TO = 0, 1  # boards of the world file


class ErringCell(ContactCell):
    """A cell whose tool is off over the target board.

    Args:
        task: with the cell and its world file.
        error: (2,) m along the target board.
    """

    def __init__(self, task: Task, error: Array) -> None:
        super().__init__(task.cell, read_world(world_file(task, None), task.cell.marker_size))
        centres = [apply(b.T_base_board, (*PLATE_CENTRE, 0.0)) for b in self.world.boards]
        self._begin, self._way = centres[FROM], centres[TO] - centres[FROM]
        self.shift = self.world.boards[TO].T_base_board[:3, :2] @ error

    def share(self, position: Array) -> float:
        """Share of the error, from 0 to 1, with the tool at a position (3,) m."""
        along = float((position - self._begin) @ self._way / (self._way @ self._way))
        return float(np.clip((along - ZONE[0]) / (ZONE[1] - ZONE[0]), 0.0, 1.0))

    def T_base_tool(self, counts: npt.ArrayLike) -> Array:
        return self._shifted(super().T_base_tool(counts))

    def _true_tool(self, counts: npt.ArrayLike, arrived: Array, now_ms: int) -> Array:
        return self._shifted(super()._true_tool(counts, arrived, now_ms))

    def _shifted(self, T: Array) -> Array:
        return transform(T[:3, :3], T[:3, 3] + self.share(T[:3, 3]) * self.shift)


@dataclass(frozen=True)
class Ran:
    """A run: cubes seated in the target board, released, told as placed, and told so in vain; its end and its cost."""

    seated: int
    released: int
    told: int
    falsely_told: int
    end: str
    cpu_s: float
    steps: int


def ran(error_mm: float, seed: int, recovers: bool, speed: float = 0.5) -> Ran:
    """Run the task once in a folder of its own."""
    angle = np.random.default_rng([seed, 20]).uniform(0.0, 2.0 * np.pi)
    error = 1e-3 * error_mm * np.array([np.cos(angle), np.sin(angle)])
    with tempfile.TemporaryDirectory() as folder:
        scenes = full_scenes(Path(folder)) if recovers else small_scenes(Path(folder))
        replace_in(scenes / "task2.world.toml", "seed = 1", f"seed = {seed}")
        if not recovers:
            replace_in(scenes / "task2.toml", 'look_after = "each"', 'look_after = "never"')
            with (scenes / "cell.toml").open("a") as cell_file:
                cell_file.write("\n[recovery]\nattempts = 0\n")
        task = read_task(scenes / "task2.toml")
        simulated = ErringCell(task, error)
        places = [
            (b.T_base_board @ b.board.T_board_hole(h))[:3, 3]
            for b in simulated.world.boards
            for h in range(4)
        ]
        if [simulated.share(p) for p in places] != [0.0] * 4 + [1.0] * 4:
            raise A465Error("the boards are too near to each other for this error", zone=ZONE)
        end, report, began = "finished", dict[str, object](), time.process_time()
        with (
            patch.object(cell.session.connection, "simulated_cell", lambda *_: simulated),
            redirect_stdout(io.StringIO()),
            redirect_stderr(io.StringIO()),
        ):
            try:
                report = run_task(
                    task.file,
                    Console(),
                    WhichCell(speed=speed, time_scale=100.0, contact=True),
                    Path(folder) / "run",
                )
            except A465Error as refused:
                if refused.data.get("reason") == "interrupted":
                    raise
                end, report = str(refused), refused.data
        cpu_s = time.process_time() - began
    return judged(simulated, report, end, cpu_s)


def full_scenes(folder: Path) -> Path:
    """A copy of the scenes in `folder`/scenes: half as many pixels do not show where a leaning cube is."""
    return Path(shutil.copytree(data_file("scenes"), folder / "scenes"))


def judged(simulated: ContactCell, report: dict[str, object], end: str, cpu_s: float) -> Ran:
    """Compare what a run said with where its cubes are."""
    boards, table_z = simulated.world.boards, simulated.cell.table_z
    found = [resting(c.T_base_cube, c.size, boards, table_z) for c in simulated.cubes(())]
    target = boards[TO].board.name
    full = {r.place for r in found if r.what == "placed" and r.place.startswith(target)}
    rows = report.get("cubes", [])
    told = [row["to"] for row in rows if row["placed"]] if isinstance(rows, list) else []
    released = sum(e.what in ("placed", "unseated", "set down", "fallen") for e in simulated.events)
    return Ran(len(full), released, len(told), len(set(told) - full), end, cpu_s, simulated.simulated_steps)


def alone(errors: list[float], seeds: range, settings: list[str], leans: bool) -> None:
    """Print a row per error: cubes that the tool alone, on straight lines, grips, carries and releases."""
    keys = {name: float(value) for name, value in (one.split("=") for one in settings)}
    print(
        f"| {'lean, deg' if leans else 'error, mm'} | cubes | seated | lost | CPU s a cube |\n|---|---|---|---|---|"
    )
    for error in errors:
        ends, began = Counter[str](), time.process_time()
        for seed in seeds:
            rng = np.random.default_rng([seed, 21])
            angle, source, target = rng.uniform(0.0, 2.0 * np.pi), int(rng.integers(4)), int(rng.integers(4))
            driven = DrivenContact(world_of(contact=keys))
            driven.fetch(source)
            way = np.array([np.cos(angle), np.sin(angle)])
            if leans:
                driven.place(target, lean=np.radians(error) * way)
            else:
                driven.place(target, tuple(1e-3 * error * way))
            ends.update(event.what for event in driven.cell.events)
        cpu_s = (time.process_time() - began) / len(seeds)
        share = 100 * ends["placed"] / len(seeds)
        print(
            f"| {error:g} | {len(seeds)} | {ends['placed']} ({share:.0f} %) | {ends['lost']} | {cpu_s:.2f} |",
            flush=True,
        )


def main() -> None:
    """Print a row per error, and how runs ended."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--runs", type=int, default=25, help="runs of four cubes per error")
    parser.add_argument("--errors", type=float, nargs="+", default=[0.0, 1.0, 2.0, 3.0], help="mm")
    parser.add_argument("--first-seed", type=int, default=1)
    parser.add_argument("--recovery", action="store_true", help="look after each cube, and recover")
    parser.add_argument("--speed", type=float, default=0.5, help="as of a465 run")
    parser.add_argument("--alone", action="store_true", help="one cube at a time, by the tool alone")
    parser.add_argument(
        "--lean", action="store_true", help="with --alone: errors are deg by which the tool leans"
    )
    parser.add_argument(
        "--set", nargs="*", default=[], help="with --alone: KEY=VALUE of [contact], in SI units"
    )
    options = parser.parse_args()
    if options.alone:
        print(f"{run_conditions()}; one cube at a time; {' '.join(options.set) or 'constants as shipped'}\n")
        alone(
            options.errors,
            range(options.first_seed, options.first_seed + options.runs),
            options.set,
            options.lean,
        )
        return
    print(f"{run_conditions()}; speed {options.speed:g}, recovery {'on' if options.recovery else 'off'}\n")
    print("| error, mm | cubes | released | seated | told as placed | not seated of these | CPU s | steps |")
    print("|---|---|---|---|---|---|---|---|")
    ends = Counter[str]()
    for error_mm in options.errors:
        runs = []
        for seed in range(options.first_seed, options.first_seed + options.runs):
            runs.append(ran(error_mm, seed, options.recovery, options.speed))
            last = runs[-1]  # told at once, as a row comes only when all of its runs are done
            done = f"{last.released} released, {last.seated} of 4 seated, {last.told} told; {last.end[:120]}"
            print(f"{error_mm:g} mm, seed {seed}: {done}", file=sys.stderr, flush=True)
        ends.update(f"{error_mm:g} mm: {run.end[:120]}" for run in runs)
        cubes = 4 * len(runs)
        released, seated, told, falsely = (
            sum(getattr(run, key) for run in runs) for key in ("released", "seated", "told", "falsely_told")
        )
        cpu_s, steps = (float(np.mean([getattr(run, key) for run in runs])) for key in ("cpu_s", "steps"))
        print(
            f"| {error_mm:g} | {cubes} | {released} | {seated} ({100 * seated / cubes:.0f} %) | {told} | {falsely} "
            f"| {cpu_s:.1f} | {steps:.0f} |",
            flush=True,
        )
    print()
    for end, count in sorted(ends.items()):
        print(f"{count} x {end}")


if __name__ == "__main__":
    main()
