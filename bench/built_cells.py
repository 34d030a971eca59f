"""Cells built anew, each calibrated by its own commands and then run: is a placement as good as the cell says?

python bench/built_cells.py --cells 8 --sessions 2

The demonstration (docs/simulated-cell.md) is one cell, whose calibration errs once. Here each cell has the errors of
scenes/realistic, built with a seed of its own: prints, holes, cubes, the table's texture and the gears differ, and the
zeros of J2 to J5 are off by up to 0.3 degrees. In each, the commands of that page calibrate lens, camera and arm, and
the task of `make run` is run in sessions that differ in noise, sway, drift, and scatter of the arm. An error is the
distance of a cube from its hole's axis when the jaws open. The stated standard deviation is the root of the summed
variances of the tool sideways at the worst hole (the calibration's `tool_sideways_mm`) and of the hole (`a465 look`).
All cubes of a cell share its calibration, so the cell is what counts: NEES is the mean over cells of the mean squared
error over the stated variance; 1 would be exact, and the worst hole's standard deviation makes it lower.
"""

from __future__ import annotations

import argparse
import json
import re
import shutil
import subprocess
import sys
import tempfile
import tomllib
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from run_conditions import run_conditions

from arm.io.storage import data_file

REALISTIC = Path("scenes/realistic")
MADE = ("camera.toml", "calibration.toml", "calibration.background.npz")
WORLDS = ("task2.world.toml", "calibration-world.toml")
COMMAND_S = 3600.0
TARGET_COUNT = 30  # photographs of the target for the lens


@dataclass(frozen=True)
class BuiltCell:
    """A cell's outcome.

    Attributes:
        refused: what the first command that failed said, else empty.
        errors_mm: a row per session, a column per cube.
        stated_mm: standard deviation of a placement, sideways.
        tool_mm: part of the calibration.
    """

    seed: int
    refused: str = ""
    errors_mm: tuple[tuple[float, ...], ...] = ()
    stated_mm: float = np.nan
    tool_mm: float = np.nan

    @property
    def nees(self) -> float:
        return float(np.mean(np.square(np.concatenate(self.errors_mm)))) / self.stated_mm**2


class _Refused(Exception):
    """A command ended with another exit code than 0."""


def built(sessions: int, photographs: int, seed: int) -> BuiltCell:
    """Build, calibrate and run one cell."""
    with tempfile.TemporaryDirectory() as folder:
        try:
            return _built(Path(folder), sessions, photographs, seed)
        except _Refused as refused:
            return BuiltCell(seed, str(refused))


def _built(folder: Path, sessions: int, photographs: int, seed: int) -> BuiltCell:
    realistic = folder / REALISTIC
    shutil.copytree(data_file("scenes"), folder / "scenes")
    for name in MADE:
        (realistic / name).unlink()
    zeros = np.random.default_rng(seed).uniform(-0.3, 0.3, 4).round(3).tolist()
    for name in WORLDS:
        _set_key(realistic / name, "build_seed", seed)
        _set_key(realistic / name, "joint_offsets_deg", [0, *zeros, 0])
    _set_key(realistic / "calibration-world.toml", "seed", seed)
    own = re.sub(r"(?m)^(calibration|background) = .*\n", "", (realistic / "cell.toml").read_text())
    (realistic / "cell.toml").write_text(own)
    _set_key(realistic / "cell.toml", "photographs", photographs)
    _calibrate(folder, seed)
    _set_key(realistic / "cell.toml", "photographs", 5)
    task = REALISTIC / "task2.toml"
    tool_mm = tomllib.loads((realistic / "calibration.toml").read_text())["made"]["tool_sideways_mm"]
    seen = json.loads(_a465(folder, "look", task, "--json"))["scenes"][0]["boards"]
    target = next(board for board in seen if board["board"] == "03-04")
    hole_mm = max(float(np.hypot(*hole["std_mm"][:2])) for hole in target["holes"])
    errors = []
    for session in range(sessions):
        _set_key(realistic / "task2.world.toml", "seed", 1000 * seed + session)
        ran = json.loads(_a465(folder, "run", task, "--json", "--time-scale", 100, "-o", f"run-{session}"))
        errors.append(tuple(cube["error_mm"] for cube in ran["cubes"]))
    return BuiltCell(seed, "", tuple(errors), float(np.hypot(tool_mm, hole_mm)), tool_mm)


def _calibrate(folder: Path, seed: int) -> None:
    """The commands of docs/simulated-cell.md."""
    world, camera = REALISTIC / "calibration-world.toml", REALISTIC / "camera.toml"
    uncalibrated = Path("scenes/uncalibrated")
    photos = ("--target", "charuco", "--count", TARGET_COUNT, "-o", "photographs")
    _a465(folder, "render", uncalibrated / "task2.toml", "--world", world, *photos)
    _a465(folder, "calibrate", "camera", "photographs", "-o", "lens.toml")
    tape = (folder / uncalibrated / "camera.toml").read_text()
    pose = tape[tape.index("[pose]") : tape.index("[calibration]")]
    (folder / camera).write_text(f"{(folder / 'lens.toml').read_text()}\n{pose}")
    collect = ("--collect", REALISTIC / "task2.toml", "--world", world)
    output = ("-o", REALISTIC / "calibration.toml", "--apply")
    _a465(folder, "calibrate", "hand-eye", "recorded.json", *collect, *output)


def _set_key(path: Path, key: str, value: object) -> None:
    text, count = re.subn(rf"(?m)^{key} = [^#\n]*", f"{key} = {value}  ", path.read_text(), count=1)
    if count != 1:
        raise ValueError(f"{path} has no key {key}")
    path.write_text(text)


def _a465(folder: Path, *arguments: object) -> str:
    command = [sys.executable, "-m", "a465", *map(str, arguments)]
    ended = subprocess.run(
        command, cwd=folder, capture_output=True, text=True, timeout=COMMAND_S, check=False
    )
    if ended.returncode != 0:
        raise _Refused(
            f"{arguments[0]} {arguments[1]}: {(ended.stderr.strip() or 'no message').splitlines()[-1]}"
        )
    return ended.stdout


def main() -> None:
    """Run, and print a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--cells", type=int, default=8)
    parser.add_argument("--sessions", type=int, default=2, help="runs of each cell")
    parser.add_argument("--photographs", type=int, default=2, help="images of a pose in hand-eye collection")
    parser.add_argument("--first-seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=1)
    options = parser.parse_args()
    print(__doc__)
    print(f"{run_conditions()}; {options.photographs} photographs of a pose\n")
    print(
        "| cell | errors, mm, a session in brackets | stated, mm | of it calibration | mean square over stated |"
    )
    print("|---|---|---|---|---|", flush=True)
    seeds = range(options.first_seed, options.first_seed + options.cells)
    done: list[BuiltCell] = []
    with ProcessPoolExecutor(options.jobs) as pool:
        for cell in pool.map(partial(built, options.sessions, options.photographs), seeds):
            if cell.refused:
                print(f"| {cell.seed} | refused: {cell.refused} | | | |", flush=True)
                continue
            done.append(cell)
            errors = " ".join("[" + " ".join(f"{e:.2f}" for e in row) + "]" for row in cell.errors_mm)
            print(
                f"| {cell.seed} | {errors} | {cell.stated_mm:.3f} | {cell.tool_mm:.3f} | {cell.nees:.2f} |",
                flush=True,
            )
    if not done:
        return
    every = np.concatenate([row for cell in done for row in cell.errors_mm])
    nees = np.array([cell.nees for cell in done])
    print(
        f"\n{len(done)} of {options.cells} cells, {len(every)} cubes: median {np.median(every):.3f}, rms "
        f"{np.sqrt(np.mean(every**2)):.3f}, worst {every.max():.3f} mm; NEES {nees.mean():.2f}, standard error "
        f"{nees.std(ddof=1) / np.sqrt(len(nees)) if len(nees) > 1 else np.nan:.2f}"
    )


if __name__ == "__main__":
    main()
