"""Is a task below the limit refused, and does the measure that the refusal offers help when it is really done?

python bench/measures.py --cases 200

Every case is a cell of scenes/realistic whose truth is drawn, with one weakness in turn: a camera that shakes, without
a background and with two or three images (`shaking`); finger tips that are known to 2 to 4 mm (`tool`); pockets that
are known to 2 to 4 mm (`sizes`); a calibration from five to seven poses with corners of 0.4 to 0.8 px (`calibration`);
a calibration like that whose file does not say from how many poses it is, with one or two cubes and four free holes
(`holes`). For the last two the clearance with errors is not asked for. Images are rendered and looked at, and
`a465 plan` is asked for its plan with the default limit, 99.7 %.

If it refuses and offers a measure, that is done: the words of the refusal are read, keys of cell or task file are set,
more images are rendered, boards are moved by hand (2 mm and 1 degree off), another recording with as many poses is
drawn and calibrated, true cubes and pockets are drawn with the smaller tolerance. Then new images are rendered and
looked at, and `a465 plan` is asked again. The measure helped if it plans. Nothing of the first look is used again, and
the noise of everything that is measured anew is drawn anew.
"""

from __future__ import annotations

import argparse
import re
import shutil
import sys
import tempfile
from collections import defaultdict
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import redirect_stderr
from dataclasses import dataclass, replace
from io import StringIO
from pathlib import Path
from typing import Any

import cv2
import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "support"))

from placements import drawn_boards
from run_conditions import run_conditions

from arm.calibration_file import read_arm_calibration, write_arm_calibration
from arm.errors import CalibrationRefused, ImpossibleError
from arm.io.storage import canonical_json, data_file, write_atomic
from arm.robot.link_errors import LinkErrors
from arm.se3 import Array, frozen, rot_z, transform
from calib.hand_eye.calibrate import calibrate_hand_eye
from cell.commands.calibration.chain import arm_calibration
from cell.commands.steps import plan_step
from cell.console import Console
from cell.files.observation import observation_to_json
from cell.files.task import Task, read_task
from cell.files.world import TrueBoard, World, read_world
from cell.session.camera_watch import look_in
from cell.sim.camera import SimulatedCamera
from cell.sim.cell import SimulatedCell
from recorded.arm_sets import LENS, MOUNTS, TARGETS, Truth, recorded, wide
from typed.command_line import replace_in
from vision.camera.model import Camera
from vision.observation import Observation

AROUND_M, AROUND = 0.003, np.radians(1.0)  # of boards; further, many are partly out of view
APART_M = 0.008
KINDS = ("shaking", "tool", "sizes", "calibration", "holes")
MEASURED_MM, TOLERANCE_SDS = 0.05, 2.0
BY_HAND_M, BY_HAND = 0.002, np.radians(1.0)


@dataclass
class Case:
    """A cell, as its files state it and as it is.

    Attributes:
        kind: of weakness.
        folder: with the files.
        world, camera: the truth.
        truth: of the arm, for recordings.
        noise_px: of the corners of recordings.
    """

    kind: str
    folder: Path
    world: World
    camera: Camera
    truth: Truth
    noise_px: float

    @property
    def files(self) -> Path:
        """Folder of cell and task file."""
        return self.folder / "scenes" / "realistic"

    def task(self) -> Task:
        """The task as its files state it now."""
        return read_task(self.files / "task2.toml")

    def set_key(self, table: str, key: str, value: object) -> None:
        """Set a key of the cell file, in a table that is written once."""
        file = self.files / "cell.toml"
        text = re.sub(rf"(?m)^{key} = .*\n", "", file.read_text())
        if f"\n[{table}]\n" not in text:
            text += f"\n[{table}]\n"
        file.write_text(text.replace(f"\n[{table}]\n", f"\n[{table}]\n{key} = {value}\n"))


@dataclass(frozen=True)
class Outcome:
    """What became of a case.

    Attributes:
        seed, kind: of the case.
        insertion: of the least certain placement; None if the task was refused for something else.
        refused: whether it was refused for that.
        measure: that was offered; "" for none.
        foreseen: insertion after it, as foreseen.
        then: insertion after it, None if the task was then refused for something else.
        helped: whether the task was planned after it.
        why: what else was in the way.
    """

    seed: int
    kind: str
    insertion: float | None = None
    refused: bool = False
    measure: str = ""
    foreseen: float = 0.0
    then: float | None = None
    helped: bool = False
    why: str = ""


def outcome_of(seed: int) -> Outcome:
    """Draw a case, plan it, do what is offered, and plan it again."""
    cv2.setNumThreads(1)
    kind, rng = KINDS[seed % len(KINDS)], np.random.default_rng([seed, 20])
    with tempfile.TemporaryDirectory() as folder:
        try:
            case = drawn_case(Path(folder), kind, rng, seed)
        except CalibrationRefused as error:
            return Outcome(seed, kind, why=str(error))
        found, data, why = _planned(case)
        if found is None or not data:
            return Outcome(seed, kind, found, why=why)
        first = Outcome(seed, kind, found, True, data.get("measure", ""), data.get("insertion_then", 0.0))
        if not first.measure:
            return first
        case.world = replace(case.world, seed=seed + 500_000)
        do(first.measure, case, rng)
        then, data, why = _planned(case)
        return replace(first, then=then, helped=then is not None and not data, why=why)


def drawn_case(folder: Path, kind: str, rng: np.random.Generator, seed: int) -> Case:
    """Draw a case and write its files."""
    shutil.copytree(data_file("scenes"), folder / "scenes")
    files = folder / "scenes" / "realistic"
    offsets = np.concatenate([[0.0], np.radians(rng.uniform(-0.3, 0.3, 4)), [0.0]])
    world = read_world(files / "task2.world.toml", 0.036)
    still = np.zeros(6)
    arm = replace(world.arm, eccentricity=still, sag=still[:2], backlash=still, warm_up=still)
    none = np.zeros(6)
    camera = LENS.at(read_arm_calibration(files / "calibration.toml").T_base_camera)
    truth = Truth(offsets, none, none, none, camera.T_base_camera, MOUNTS["perpendicular"], np.ones(6))
    weak = kind in ("calibration", "holes")
    case = Case(kind, folder, world, camera, truth, float(rng.uniform(0.4, 0.8)) if weak else 0.3)
    replace_in(files / "cell.toml", 'background = "calibration.background.npz"\n', "")
    replace_in(files / "cell.toml", 'camera = "camera.toml" ', 'camera = "../cameras/lab.toml" ')
    image = replace(world.image, drift=0.0, sway=0.1, sway_turn=0.0)
    if kind == "shaking":
        image = replace(image, sway=0.5, corner_scatter=float(rng.uniform(0.3, 0.8)))
        case.set_key("look", "photographs", int(rng.integers(2, 4)))
        for key, value in (("_mm", 5), ("_height_mm", 20), ("_deg", 10)):
            case.set_key("look", f"least_certain{key}", value)
    made, wide_mm = world.made, float(rng.uniform(2.0, 4.0))
    if kind == "tool":
        case.set_key("accuracy", "tool_within_mm", wide_mm)
    if kind == "sizes":
        case.set_key("accuracy", "pocket_within_mm", wide_mm)
        made = replace(made, pocket=1e-3 * wide_mm / TOLERANCE_SDS)
    if weak:
        case.set_key("accuracy", "sigmas", 0)
    if kind == "holes":
        cubes = [(0,), (1,), (2,), (3,), (0, 1), (2, 3)][int(rng.integers(6))]
        boards = tuple(replace(b, cubes=cubes if b.cubes else ()) for b in world.boards)
        world = replace(world, boards=boards)
    calibrate(
        case, {"calibration": int(rng.integers(5, 8)), "holes": int(rng.integers(6, 9))}.get(kind, 40), rng
    )
    case.world = replace(
        world,
        boards=drawn_boards(replace(world, boards=_apart(world)), rng, AROUND_M, AROUND),
        camera=camera,
        joint_offsets=offsets,
        links=LinkErrors.none(),
        arm=arm,
        image=image,
        made=made,
        seed=seed,
        build_seed=seed,
    )
    return case


def _apart(world: World) -> tuple[TrueBoard, ...]:
    """The boards, further from each other: the demonstration has just enough room for the gripper between them."""
    first, *others = world.boards
    away = transform(t=(0.0, -APART_M, 0.0))
    return first, *(replace(b, T_base_board=away @ b.T_base_board) for b in others)


def calibrate(case: Case, poses: int, rng: np.random.Generator) -> None:
    """Draw a recording of as many poses, calibrate from it, and write the calibration.

    Raises:
        CalibrationRefused: see `calibrate_hand_eye`.
    """
    joints = wide(case.truth, TARGETS["marker"], poses, rng)
    at = joints + case.world.arm.scatter * rng.standard_normal(joints.shape)
    recording = replace(recorded(case.truth, at, "marker", rng, case.noise_px), joints=frozen(joints))
    found = arm_calibration(calibrate_hand_eye(recording))
    file = case.files / "calibration.toml"
    shipped = read_arm_calibration(data_file("scenes/realistic/calibration.toml"))
    cell = read_task(data_file("scenes/task2.toml")).cell
    lens = cell.nominal_camera.lens_digest
    made = found.made if case.kind != "holes" else {}
    found = replace(found, unit=shipped.unit, dh=shipped.dh, lens=lens, intrinsics=None, made=made)
    write_arm_calibration(file, found)


def do(measure: str, case: Case, rng: np.random.Generator) -> None:
    """Do what a refusal offers, by its words."""
    if images := re.search(r"look\.photographs = (\d+)", measure):
        case.set_key("look", "photographs", int(images[1]))
    elif "accuracy.tool_within_mm" in measure:
        case.set_key("accuracy", "tool_within_mm", MEASURED_MM)
    elif "cube.size_tolerance_mm" in measure:
        case.set_key("accuracy", "pocket_within_mm", MEASURED_MM)
        case.set_key("cube", "size_tolerance_mm", MEASURED_MM)
        sigma = 1e-3 * MEASURED_MM / TOLERANCE_SDS
        made = replace(case.world.made, pocket=sigma, cube=sigma)
        case.world = replace(case.world, made=made)
    elif poses := re.search(r"with (\d+) poses instead", measure):
        calibrate(case, int(poses[1]), rng)
    elif holes := re.search(r"to_holes = (\[.*\])", measure):
        file = case.files / "task2.toml"
        file.write_text(f"{file.read_text()}\nto_holes = {holes[1]}\n")
    elif higher := re.search(r"stands (\d+) mm higher", measure):
        _move(case, np.array([0.0, 0.0, 1e-3 * int(higher[1])]), measure, rng)
    elif nearer := re.search(r"by (\d+) mm towards the arm's base", measure):
        named = [b for b in case.world.boards if b.board.name in measure]
        x, y = np.mean([transform_centre(b.T_base_board) for b in named], axis=0)[:2]
        _move(case, -1e-3 * int(nearer[1]) * np.array([x, y, 0.0]) / np.hypot(x, y), measure, rng)
    else:
        raise ValueError(f"a measure that nobody knows how to do: {measure}")


def transform_centre(T_base_board: Array) -> Array:
    """Centre of a plate's top, (3,) m."""
    return np.asarray((T_base_board @ np.array([0.09, 0.07, 0.0, 1.0]))[:3])


def _move(case: Case, by: Array, measure: str, rng: np.random.Generator) -> None:
    """Move the boards that the measure names, by hand."""
    boards = []
    for b in case.world.boards:
        if b.board.name in measure:
            off = np.array([*rng.uniform(-BY_HAND_M, BY_HAND_M, 2), 0.0])
            x, y, _ = transform_centre(b.T_base_board)
            turn = transform(rot_z(float(rng.uniform(-BY_HAND, BY_HAND))))
            about = transform(t=(x, y, 0.0)) @ turn @ transform(t=(-x, -y, 0.0))
            b = replace(b, T_base_board=transform(t=by + off) @ about @ b.T_base_board)
        boards.append(b)
    case.world = replace(case.world, boards=tuple(boards))


def _planned(case: Case) -> tuple[float | None, dict[str, Any], str]:
    """Look and plan: insertion of the least certain placement, data of its refusal, and what else was in the way."""
    task = case.task()
    cell = task.cell
    counts = cell.unit.counts(cell.q_start)
    look, plan = case.files / "look.json", case.files / "plan.json"
    try:
        seen: Observation = look_in(
            cell,
            SimulatedCamera(
                SimulatedCell(cell, case.world), case.camera, lambda: counts, cell.dictionary
            ).grab(cell.photographs),
        )
        write_atomic(look, canonical_json(observation_to_json(seen, cell.camera)) + "\n")
        with redirect_stderr(StringIO()):
            said = plan_step(task.file, look, plan, 0.5, Console(as_json=True))
    except ImpossibleError as error:
        if "insertion" in error.data:
            return float(error.data["insertion"]), error.data, str(error)
        return None, {}, str(error)
    return min(p["insertion_probability"] for p in said["placements"]), {}, ""


def main() -> None:
    """Run, and print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--cases", type=int, default=200)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--kind", choices=KINDS, help="only cases with this weakness")
    options = parser.parse_args()
    print(__doc__)
    print(f"{run_conditions()}; {options.cases} cases from seed {options.first_seed}\n", flush=True)
    with ProcessPoolExecutor(options.jobs) as pool:
        seeds: Sequence[int] = range(options.first_seed, options.first_seed + options.cases)
        if options.kind is not None:
            first = options.first_seed - options.first_seed % len(KINDS) + KINDS.index(options.kind)
            seeds = range(first, first + options.cases * len(KINDS), len(KINDS))
        outcomes = []
        for outcome in pool.map(outcome_of, seeds):
            outcomes.append(outcome)
            print(outcome, file=sys.stderr, flush=True)
    _tell_refusals(outcomes)
    _tell_measures(outcomes)
    for o in outcomes:
        if o.why and (o.insertion is None or (o.measure and not o.helped)):
            print(f"{o.seed}, {o.kind}: {o.measure or 'nothing was offered'}: {o.why[:200]}")


def _tell_refusals(outcomes: list[Outcome]) -> None:
    print(
        "| weakness | cases | refused before | at least 99.7 % | planned | below | refused | a measure offered |"
    )
    print("|---|---|---|---|---|---|---|---|")
    for kind in (*KINDS, None):
        of = [o for o in outcomes if kind in (None, o.kind)]
        known = [o for o in of if o.insertion is not None]
        below = [o for o in known if o.insertion is not None and o.insertion < 0.997]
        cells = len(of), len(of) - len(known), len(known) - len(below)
        planned, refused = sum(not o.refused for o in known), sum(o.refused for o in below)
        row = (kind or "all", *cells, planned, len(below), refused, sum(bool(o.measure) for o in below))
        print(f"| {' | '.join(map(str, row))} |")


def _tell_measures(outcomes: list[Outcome]) -> None:
    done: dict[str, list[Outcome]] = defaultdict(list)
    for o in outcomes:
        if o.measure:
            done[re.sub(r"[\d-]+\.?\d*(, \d)*", "n", o.measure.split(" (")[0])].append(o)
            done["all"].append(o)
    print(
        "\n| measure | offered and done | then planned | then at least 99.7 % was foreseen | median insertion |"
    )
    print("|---|---|---|---|---|")
    for words, of in sorted(done.items(), key=lambda item: (item[0] == "all", item[0])):
        helped = sum(o.helped for o in of)
        then = [o.then for o in of if o.then is not None]
        before = [o.insertion for o in of if o.insertion is not None]
        medians = f"{100 * np.median(before):.2f} % to {100 * np.median(then):.2f} %" if then else ""
        foreseen = f"{100 * np.median([o.foreseen for o in of]):.2f} %"
        print(f"| {words} | {len(of)} | {helped} ({100 * helped / len(of):.0f} %) | {foreseen} | {medians} |")
    print()


if __name__ == "__main__":
    main()
