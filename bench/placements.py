"""Is the error budget of a placement right? Predicted errors and insertion against cells drawn from what is stated.

python bench/placements.py --cells 200

Each case is a cell whose truth is drawn from what its files state: camera, lens, joint offsets and links from the
calibration's covariance (the calibration of scenes/realistic), the scatter of the joints at each arrival, marker and
hole positions, widths of pockets and cubes from their tolerances. The true camera sways, blurs, scatters corners and
is compared with a background of its own, as in scenes/realistic. Boards stand within 10 mm and 8 degrees of the
demonstration's. Five images are rendered and looked at, the task is planned, and at the counts where the plan moves the
jaws, the simulated cell grips and releases the true cubes. In case n all standard deviations, drawn and stated, are
multiplied by 1, 1.75, 2.5, 3.25 and 4 in turn, so that insertion becomes doubtful; the camera's noise is not.

NEES is the squared error in the plate's plane over its covariance, divided by 2 components: 1 is honest. The cubes of a
cell share most errors, so its standard error is taken over cells. An ellipse holds 95 % if the covariance is right.
Cubes that were pushed or missed at the source count as not entered.
"""

from __future__ import annotations

import argparse
import shutil
import sys
import tempfile
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import cv2
import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "support"))

from run_conditions import run_conditions

from arm.calibration_file import read_arm_calibration, write_arm_calibration
from arm.errors import ImpossibleError
from arm.io.storage import data_file
from arm.plan_file import GripperStep, Move, Plan
from arm.robot.link_errors import LinkErrors
from arm.se3 import Array, inverse, moved, rot_z, transform
from calib.model.intrinsics import camera_of, vector_of
from cell.accuracy.placement import PlacementBudget
from cell.accuracy.plan_budgets import plan_budgets
from cell.config.cell import Cell
from cell.files.task import Task, read_task
from cell.files.world import TrueBoard, World, read_world
from cell.session.camera_watch import look_in, take_background, watch_with
from cell.sim.arm import Arrival
from cell.sim.camera import SimulatedCamera
from cell.sim.cell import SimulatedCell
from cell.task.planning import Rest, plan_rest
from typed.command_line import replace_in
from vision.camera.model import Camera
from vision.observation import Observation

SCALES = (1.0, 1.75, 2.5, 3.25, 4.0)
AROUND_M, AROUND = 0.010, np.radians(8.0)
BINS = 5  # with as many cubes each, by what was predicted
ELLIPSE = 5.991  # chi-square of two components that 95 % stay below


@dataclass(frozen=True)
class Placement:
    """One cube: what was predicted, and what happened."""

    seed: int
    scale: float
    insertion: float
    entered: bool
    chi2: float
    off_mm: float
    stated_mm: float


def cell_of(seed: int) -> list[Placement] | str:
    """The placements of one cell, or why there are none."""
    cv2.setNumThreads(1)
    scale = SCALES[seed % len(SCALES)]
    with tempfile.TemporaryDirectory() as folder:
        task, world = stated(Path(folder), scale)
        world, camera = drawn_world(task.cell, world, scale, np.random.default_rng(seed), seed)
        try:
            seen = look_at(task, world, camera)
            plan = plan_rest(Rest(task, seen, task.cell.q_start, 0.5))
        except ImpossibleError as error:
            return f"{seed}: {error}"
    if plan is None:
        return f"{seed}: nothing to do"
    return released(task.cell, world, plan, {b.cube: b for b in plan_budgets(task.cell, seen, plan)}, scale)


def stated(folder: Path, scale: float) -> tuple[Task, World]:
    """The files of scenes/realistic with all standard deviations multiplied."""
    scenes = Path(shutil.copytree(data_file("scenes"), folder / "scenes")) / "realistic"
    made = read_arm_calibration(scenes / "calibration.toml")
    if made.covariance is None or made.scatter is None:
        raise ValueError("the calibration has no covariance")
    write_arm_calibration(
        scenes / "calibration.toml",
        replace(made, covariance=scale**2 * made.covariance, scatter=scale * made.scatter),
    )
    cell = scenes / "cell.toml"
    replace_in(cell, "made_within_mm = 0.1 ", f"made_within_mm = {0.1 * scale} ")
    replace_in(cell, "size_mm = 40", f"size_mm = 40\nsize_tolerance_mm = {0.1 * scale}")
    replace_in(cell, "# least_certain_mm = 0.6 ", f"least_certain_mm = {0.6 * scale} ")
    replace_in(cell, "# least_certain_height_mm = 2.0 ", f"least_certain_height_mm = {2.0 * scale} ")
    replace_in(cell, "# least_certain_deg = 1.0 ", f"least_certain_deg = {1.0 * scale} ")
    with cell.open("a") as file:
        file.write(
            f"\n[accuracy]\nleast_insertion = 0\ntool_within_mm = 0\npocket_within_mm = {0.1 * scale}\n"
        )
    return read_task(scenes / "task2.toml"), read_world(scenes / "task2.world.toml", 0.036)


def drawn_world(
    cell: Cell, world: World, scale: float, rng: np.random.Generator, seed: int
) -> tuple[World, Camera]:
    """A world, and the pose and lens of its camera, drawn from what the files state."""
    made = cell.calibration
    if made is None or made.covariance is None or made.scatter is None:
        raise ValueError("the cell is not calibrated")
    values, vectors = np.linalg.eigh(made.covariance)
    x = vectors @ (np.sqrt(np.clip(values, 0.0, None)) * rng.standard_normal(len(values)))
    offsets, d, a, alpha = x[6:30].reshape(4, 6)
    camera = camera_of(vector_of(cell.camera) + x[30:], cell.camera.size).at(
        moved(cell.camera.T_base_camera, x[:6])
    )
    still = np.zeros(6)
    arm = replace(
        world.arm, scatter=made.scatter, eccentricity=still, sag=still[:2], backlash=still, warm_up=still
    )
    boards = drawn_boards(world, rng)
    prints = replace(
        world.prints, glued=scale * world.prints.glued, glued_turn=scale * world.prints.glued_turn
    )
    hole, pocket, cube = (scale * of for of in (world.made.hole, world.made.pocket, world.made.cube))
    true = replace(
        world,
        boards=boards,
        camera=camera,
        joint_offsets=made.joint_offsets + offsets,
        links=LinkErrors(made.links.d + d, made.links.a + a, made.links.alpha + alpha),
        arm=arm,
        seed=seed,
        build_seed=seed,
        prints=prints,
        made=replace(world.made, hole=hole, pocket=pocket, cube=cube),
    )
    return true, camera


def drawn_boards(
    world: World, rng: np.random.Generator, around_m: float = AROUND_M, around: float = AROUND
) -> tuple[TrueBoard, ...]:
    """The boards of a world, moved and turned on the table."""
    boards = []
    for b in world.boards:
        shift, turn = rng.uniform(-around_m, around_m, 2), float(rng.uniform(-around, around))
        T = b.T_base_board
        about = transform(t=(*T[:2, 3], 0.0)) @ transform(rot_z(turn)) @ transform(t=(*-T[:2, 3], 0.0))
        boards.append(replace(b, T_base_board=transform(t=(*shift, 0.0)) @ about @ T))
    return tuple(boards)


def look_at(task: Task, world: World, camera: Camera) -> Observation:
    """The look of a run, with a background that the same camera took while it stood where it was calibrated."""
    cell = task.cell
    counts = cell.unit.counts(cell.q_start)

    def images(of: World) -> list[np.ndarray]:
        return SimulatedCamera(SimulatedCell(cell, of), camera, lambda: counts, cell.dictionary).grab(
            cell.photographs
        )

    still = replace(world.image, sway=0.0, sway_turn=0.0, drift=0.0)
    background, _ = take_background(cell, images(replace(world, boards=(), image=still, seed=world.seed + 1)))
    return look_in(cell, images(world), watch=watch_with(background, cell))


def released(
    cell: Cell, world: World, plan: Plan, budgets: dict[str, PlacementBudget], scale: float
) -> list[Placement]:
    """Grip and release the true cubes where the plan moves the jaws."""
    simulated, gripper, counts = SimulatedCell(cell, world), cell.unit.gripper, plan.start
    gripped, found = False, []
    for number, step in enumerate(plan.steps):
        if isinstance(step, Move):
            counts = step.path.end
        if not isinstance(step, GripperStep):
            continue
        simulated.arrival = partial(Arrival, number)
        now = gripper.adc(cell.gripper.fraction_closed(simulated.jaw_opening))
        before = len(simulated.events)
        simulated.jaws(counts, now, gripper.adc(step.fraction_closed))
        events = simulated.events[before:]
        if step.cube is None:
            continue
        if step.action == "close":
            gripped = any(event.what == "gripped" for event in events)
            continue
        cube = plan.task["cubes"][step.cube]
        budget = budgets[cube["cube"]]
        off = _off_axis(simulated, cube["to"], events[-1].T_base_cube) if gripped else np.full(2, np.nan)
        chi2 = float(off @ np.linalg.solve(budget.covariance[:2, :2], off))
        entered = gripped and events[-1].what == "placed"
        sizes = 1e3 * float(np.linalg.norm(off)), 1e3 * budget.sideways
        found.append(Placement(world.seed, scale, budget.insertion, entered, chi2, *sizes))
    return found


def _off_axis(simulated: SimulatedCell, place: str, T_base_cube: Array | None) -> Array:
    """Where the axis of a cube passes through the plate's top, (2,) m in the true hole's frame."""
    if T_base_cube is None:
        raise ValueError("the event has no cube")
    name, _, number = place.rpartition("/")
    board = next(b for b in simulated.world.boards if b.board.name == name)
    T_base_hole = board.T_base_board @ board.board.T_board_hole(int(number) - 1)
    T = inverse(T_base_hole) @ T_base_cube
    return np.asarray(T[:2, 3] - T[:2, 2] * T[2, 3] / T[2, 2])


def main() -> None:
    """Run, and print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--cells", type=int, default=200)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=1)
    options = parser.parse_args()
    print(__doc__)
    print(f"{run_conditions()}; {options.cells} cells from seed {options.first_seed}\n")
    placements: list[Placement] = []
    seeds = range(options.first_seed, options.first_seed + options.cells)
    with ProcessPoolExecutor(options.jobs) as pool:
        for found in pool.map(cell_of, seeds):
            if isinstance(found, str):
                print(f"refused, {found}", flush=True)
            else:
                placements += found
    _tell_entering(placements)
    _tell_errors(placements)


def _tell_entering(placements: list[Placement]) -> None:
    from scipy.stats import binom

    print("\n| predicted | cubes | expected to enter | entered | 99 % of binomial draws |")
    print("|---|---|---|---|---|")
    for of in np.array_split(np.array(sorted(placements, key=lambda p: p.insertion), dtype=object), BINS):
        low, high = of[0].insertion, of[-1].insertion
        mean = float(np.mean([p.insertion for p in of]))
        bounds = binom.ppf([0.005, 0.995], len(of), mean)
        entered = sum(p.entered for p in of)
        row = f"| {low:.4f} to {high:.4f} | {len(of)} | {mean * len(of):.1f} | {entered} "
        print(f"{row}| {bounds[0]:.0f} to {bounds[1]:.0f} |")


def _tell_errors(placements: list[Placement]) -> None:
    print("\n| scale | cubes | rms off the axis, mm | stated | NEES | standard error | in the 95 % ellipse |")
    print("|---|---|---|---|---|---|---|")
    for scale in (*SCALES, None):
        of = [p for p in placements if scale in (None, p.scale) and np.isfinite(p.chi2)]
        if not of:
            continue
        by_cell: dict[int, list[float]] = {}
        for p in of:
            by_cell.setdefault(p.seed, []).append(p.chi2 / 2.0)
        cells = np.array([np.mean(chi2) for chi2 in by_cell.values()])
        rms = [
            float(np.sqrt(np.mean(np.square([getattr(p, key) for p in of]))))
            for key in ("off_mm", "stated_mm")
        ]
        inside = 100.0 * float(np.mean([p.chi2 < ELLIPSE for p in of]))
        error = cells.std(ddof=1) / np.sqrt(len(cells)) if len(cells) > 1 else np.nan
        name = "all" if scale is None else f"{scale:g}"
        print(
            f"| {name} | {len(of)} | {rms[0]:.3f} | {rms[1]:.3f} | {np.mean([p.chi2 for p in of]) / 2.0:.2f} "
            f"| {error:.2f} | {inside:.1f} % |"
        )


if __name__ == "__main__":
    main()
