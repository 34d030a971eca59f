"""Does a run recover? Whole runs of Task 2 in realistic cells, with and without faults of grasps and releases.

python bench/recovery.py --runs 50              # 4 missed grasps and 4 cubes left oblique or beside in each
python bench/recovery.py --runs 100 --faultless

Each run is `a465 run` on scenes/realistic with a seed of its own and its boards within 5 mm and 5 degrees of the
demonstration's. Boards for which the task is refused before anything moves are drawn again, and counted. With faults,
every first grasp of a cube misses. Two second grasps leave the cube beside its pocket, and so do two releases: leaning
in one of four directions, rotated on the rim, 4 mm too high, or flat on the plate 24 to 35 mm aside with any yaw. A
cube has three attempts after the first. What no look promises to tell is not drawn:

- a cube of which a part, with 3 mm around it, is out of view;
- a cube aside that touches the cube of another hole, or that with 3 mm around it covers a part of any marker or of its
  white border in the camera's view: a board with a hidden marker is not found;
- a cube that stands less than 4 mm too high (docs/occupancy.md, "Is it placed?"): it is always 4 mm.

Boards for which a cube can be left nowhere so are drawn again too.

A cube is told as placed if the report says so, and seated if it truly is in the pocket that the report names.
"""

from __future__ import annotations

import argparse
import json
import shutil
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from unittest.mock import patch

import cv2
import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "support"))

from run_conditions import run_conditions

from arm.board import PLATE_CENTRE, PLATE_SIZE, QUIET_ZONE, Board, seat_depth
from arm.errors import ImpossibleError
from arm.io.storage import data_file
from arm.numerics.products import mul, norm
from arm.se3 import Array, apply, frozen, inverse, rot_z, transform
from cell.files.world import TrueBoard
from cell.sim.cell import SimulatedCell
from cell.sim.release_faults import T_hole_released
from tasks.whole_run import WholeRun, run_whole
from vision.camera.model import Camera

FAULTS = ("half", "rim", "high", "aside")
AROUND_MM, AROUND_DEG = 5.0, 5.0
MOST_REFUSED = 20
MOST_PLACES = 1000  # drawn for one cube
ON_SEAT = 1e-3  # m from where a seated cube's centre is
APART = 0.047  # m between the middle of a cube that lies aside and any other hole
TOUCHES = 1e-3  # m between two cubes that count as touching
AROUND = 3e-3  # m around a cube that must be in view, and hide no marker
INSIDE = 0.024  # m between the middle of a cube and the border of its plate


@dataclass(frozen=True)
class Outcome:
    """One run.

    Attributes:
        told, seated: number of cubes told as placed, and of these truly seated in the named hole.
        in_target: number truly seated in the target board.
        cubes: number of cubes.
        faults: events of grasps and releases that went wrong, by kind.
        refused: boards drawn before for which the task was refused.
        cpu_s: processor time.
        error: why the run ended, or "".
        remarks: of cubes that were not placed.
    """

    seed: int
    told: int
    seated: int
    in_target: int
    cubes: int
    faults: Counter[str]
    refused: int
    cpu_s: float
    error: str
    remarks: tuple[str, ...]


def run_of(seed: int, faultless: bool) -> Outcome:
    """One run in the first cell drawn for its seed in which the task is possible."""
    cv2.setNumThreads(1)
    rng = np.random.default_rng(seed)
    for refused in range(MOST_REFUSED):
        begin = time.process_time()
        try:
            with tempfile.TemporaryDirectory() as folder:
                run = _run(Path(folder), seed, rng, faultless)
        except NowhereError:
            continue
        moved = run.simulated is not None and bool(run.simulated.events)
        if moved or not isinstance(run.error, ImpossibleError):
            return _outcome(run, seed, refused, time.process_time() - begin)
    raise ValueError(f"seed {seed}: no boards for which the task is possible")


def _run(folder: Path, seed: int, rng: np.random.Generator, faultless: bool) -> WholeRun:
    scenes = Path(shutil.copytree(data_file("scenes"), folder / "scenes")) / "realistic"
    world = scenes / "task2.world.toml"
    text = _moved(world.read_text(), rng).replace("seed = 1 ", f"seed = {seed} ", 1)
    world.write_text(text if faultless else _with_faults(text, rng))
    left = _Left(rng)
    with patch.object(SimulatedCell, "T_base_left", lambda *given: left(*given)):
        return run_whole(scenes / "task2.toml", folder / "run")


def _moved(text: str, rng: np.random.Generator) -> str:
    """The world file with its boards moved a little."""
    lines = []
    for line in text.splitlines():
        key, _, value = line.partition(" = ")
        if key == "centre_mm":
            x, y, z = json.loads(value.split("#")[0])
            dx, dy = rng.uniform(-AROUND_MM, AROUND_MM, 2)
            line = f"centre_mm = [{x + dx:.3f}, {y + dy:.3f}, {z}]"
        elif key == "yaw_deg":
            line = f"yaw_deg = {float(value.split('#')[0]) + rng.uniform(-AROUND_DEG, AROUND_DEG):.3f}"
        lines.append(line)
    return "\n".join(lines) + "\n"


def _with_faults(text: str, rng: np.random.Generator) -> str:
    a, b, c, d = (str(fault) for fault in rng.choice(FAULTS, 4))
    once, twice = ["missed", "held"], ["missed", "held", "held"]
    grasps = [*twice, once[0], a, once[1], *twice, once[0], b, once[1]]
    releases = [c, "seated", "seated", d, "seated", "seated"]
    return f"grasps = {json.dumps(grasps)}\nreleases = {json.dumps(releases)}\n{text}"


class NowhereError(Exception):
    """A cube can be left nowhere as it should be."""


class _Left:
    """Where a cube is left, drawn anew: in place of `SimulatedCell.T_base_left`."""

    def __init__(self, rng: np.random.Generator) -> None:
        self._rng = rng

    def __call__(self, cell: SimulatedCell, fault: str, b: TrueBoard, hole: int, size: float) -> Array:
        for _ in range(MOST_PLACES):
            T_board_cube = mul(
                b.board.T_board_hole(hole), self._in_hole(fault, size, seat_depth(size, b.board.pocket))
            )
            T_base_cube = frozen(mul(b.T_base_board, T_board_cube))
            if _in_view(cell, T_base_cube, size) and (
                fault != "aside"
                or (
                    _has_room(b.board, T_board_cube, hole, size)
                    and not _hides_marker(cell, T_base_cube, size)
                )
            ):
                return T_base_cube
        raise NowhereError

    def _in_hole(self, fault: str, size: float, depth: float) -> Array:
        T, rng, quarter = T_hole_released(fault, size, depth), self._rng, np.pi / 2.0
        if fault == "half":
            return np.asarray(mul(transform(rot_z(float(rng.integers(4)) * quarter)), T))
        if fault == "rim":
            x, y = rng.uniform(-3e-3, 3e-3, 2)
            return np.asarray(transform(rot_z(rng.uniform(0.22, 0.78) * quarter), (x, y, T[2, 3])))
        if fault == "high":
            return T
        away, towards, yaw = rng.uniform(0.024, 0.035), *rng.uniform(-np.pi, np.pi, 2)
        return np.asarray(transform(rot_z(yaw), (away * np.cos(towards), away * np.sin(towards), T[2, 3])))


def _in_view(cell: SimulatedCell, T_base_cube: Array, size: float) -> bool:
    """Whether a cube and what is `AROUND` it are in the image; one that is not cannot be located."""
    camera, half = _camera(cell), size / 2.0
    side = (-half - AROUND, half + AROUND)
    pixels = camera.project_base(apply(T_base_cube, [(x, y, half) for x in side for y in side]))
    return bool(((pixels > 0.0) & (pixels < np.array(camera.size) - 1.0)).all())


def _hides_marker(cell: SimulatedCell, T_base_cube: Array, size: float) -> bool:
    """Whether a cube, with what is `AROUND` it, covers a part of a marker or of its white border in the image."""
    camera, side = _camera(cell), (-size / 2.0 - AROUND, size / 2.0 + AROUND)
    corners = [(x, y, z) for x in side for y in side for z in side]
    cube_px = cv2.convexHull(camera.project_base(apply(T_base_cube, corners)).astype(np.float32))
    for b in cell.world.boards:
        for marker in b.board.marker_corners():
            middle = marker.mean(axis=0)
            bordered = middle + (1.0 + 2.0 * QUIET_ZONE) * (marker - middle)
            marker_px = camera.project_base(apply(b.T_base_board, bordered)).astype(np.float32)
            if cv2.intersectConvexConvex(cube_px, marker_px)[0] > 0.0:
                return True
    return False


def _camera(cell: SimulatedCell) -> Camera:
    return cell.world.camera or cell.cell.nominal_camera


def _has_room(board: Board, T_board_cube: Array, hole: int, size: float) -> bool:
    """Whether a flat cube stands on its plate alone, and touches no cube in another hole."""
    xy, half = T_board_cube[:2, 3], np.array(PLATE_SIZE[:2]) / 2.0 - INSIDE
    others = np.delete(np.asarray(board.holes)[:, :2], hole, axis=0)
    if (np.abs(xy - PLATE_CENTRE) >= half).any() or np.linalg.norm(others - xy, axis=1).min() <= APART:
        return False
    square = (size / 2.0 + TOUCHES / 2.0) * np.array([(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)])
    turned = (mul(square, T_board_cube[:2, :2].T) + xy).astype(np.float32)
    return not any(
        cv2.intersectConvexConvex(turned, (square + other).astype(np.float32))[0] > 0.0 for other in others
    )


def _outcome(run: WholeRun, seed: int, refused: int, cpu_s: float) -> Outcome:
    cell = run.simulated
    if cell is None:
        raise ValueError(f"seed {seed}: no boards for which the task is possible")
    report: dict[str, Any] = run.report or (run.error.data if run.error is not None else {})
    rows = [row for row in report.get("cubes", []) if isinstance(row, dict)]
    held = {place: name for name, place in _in_pockets(cell)}
    told = [row for row in rows if row["placed"]]
    wrong = [event for event in cell.events if event.what in ("pushed", "unseated")]
    faults = Counter(event.message.split(": ")[1].split(",")[0] for event in wrong)
    faults["missed"] = sum(event.what == "missed" for event in cell.events)
    target = run.task.to_board
    return Outcome(
        seed,
        len(told),
        sum(row["to"] in held for row in told),
        sum(target is not None and place.startswith(target.name) for place in held),
        len(cell.cubes(run.task.cell.unit.counts(run.task.cell.q_start))),
        faults,
        refused,
        cpu_s,
        "" if run.error is None else str(run.error),
        tuple(remark for row in rows if not row["placed"] for remark in row["remarks"][-2:]),
    )


def _in_pockets(cell: SimulatedCell) -> Iterator[tuple[str, str]]:
    """Names of cubes that truly are seated, and of their holes."""
    for cube in cell.cubes(cell.cell.unit.counts(cell.cell.q_start)):
        for b in cell.world.boards:
            for hole in range(len(b.board.holes)):
                T_base_hole = mul(b.T_base_board, b.board.T_board_hole(hole))
                T = mul(inverse(T_base_hole), cube.T_base_cube)
                seat = cube.size / 2.0 - seat_depth(cube.size, b.board.pocket)
                if norm(T[:3, 3] - (0.0, 0.0, seat)) < ON_SEAT and T[2, 2] > np.cos(np.radians(1.0)):
                    yield cube.name, f"{b.board.name}/{hole + 1}"


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--runs", type=int, default=50)
    parser.add_argument("--first", type=int, default=1, help="seed of the first run")
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--faultless", action="store_true")
    given = parser.parse_args()
    print(run_conditions(), flush=True)
    print(
        f"{given.runs} runs from seed {given.first}, {'faultless' if given.faultless else 'with faults'}",
        flush=True,
    )
    done: list[Outcome] = []
    seeds = range(given.first, given.first + given.runs)
    with ProcessPoolExecutor(given.jobs) as pool:
        for one in pool.map(run_of, seeds, [given.faultless] * len(seeds)):
            done.append(one)
            odd = one.told != one.cubes or one.seated != one.told
            print(
                f"seed {one.seed}: {one.told} of {one.cubes} told as placed, {one.seated} of these seated, "
                f"{dict(one.faults)}, {one.cpu_s:.0f} s of CPU"
                + (f": {one.error} {one.remarks}" if odd else ""),
                flush=True,
            )
    cubes, faults = sum(one.cubes for one in done), sum((one.faults for one in done), Counter())
    told, seated = sum(one.told for one in done), sum(one.seated for one in done)
    print(f"\nboards drawn again because the task was refused: {sum(one.refused for one in done)}")
    print(f"faults: {dict(faults)}")
    print(f"cubes: {cubes}; seated in the target board: {sum(one.in_target for one in done)}")
    print(f"told as placed: {told}; of these not seated: {told - seated}")
    print(f"runs in which every cube was placed: {sum(one.told == one.cubes for one in done)} of {len(done)}")
    print(f"CPU of a run: median {np.median([one.cpu_s for one in done]):.0f} s")


if __name__ == "__main__":
    main()
