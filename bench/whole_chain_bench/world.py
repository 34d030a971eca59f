"""A drawn world: lens, arm, boards, and what the cell sees and plans in it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from draws import draw_world
from hand_eye_bench.cases import Case, postures

from arm.calibration_file import write_arm_calibration
from arm.controller.unit import load_unit
from arm.errors import A465Error, CalibrationRefused
from arm.io.storage import data_file
from arm.plan_file import GripperStep, Move, Plan
from arm.se3 import Array, apply, frozen
from calib.camera.calibrate import calibrate_camera
from calib.hand_eye.calibrate import HandEye, calibrate_hand_eye
from calib.hand_eye.tool_error import TOOL
from calib.recordings.arm import ArmRecording
from cell.commands.calibration.chain import arm_calibration
from cell.files.task import Task, read_task
from cell.files.world import read_world
from cell.sim.target_photos import random_poses
from cell.task.planning import Rest, plan_rest
from pictures.targets import CHARUCO, photos, seen
from recorded.arm_sets import LENS, TARGETS, Truth, draw_truth, recorded
from recorded.real_arms import RealArm, draw_real_arm
from vision.boards.pose import estimate_board_pose
from vision.camera.model import write_camera
from vision.markers.detect import Marker
from vision.observation import Observation, ObservedBoard
from vision.occupancy.classify import Occupancy
from vision.targets.target import TargetView

VIEWS, POSES, CANDIDATES, FRAMES = 20, 24, 300, 5
NOISE_PX = (0.1, 0.3)
SWAY_PX = 0.04  # left of it after correction: what the background's shift of real photographs is off by
MADE = 1e-4  # m; standard deviation of markers and holes, half the tolerance of the CSV
TARGET = "charuco"
UNIT = "crs93"


@dataclass(frozen=True, eq=False)
class World:
    """What is true in a world.

    Attributes:
        truth: arm, camera and mount.
        arm: how the arm errs; None if it repeats.
        noise_px: of every corner.
        size, inwards_px: of the target's print and its corners, which the calibration does not know.
        joints: readings of the hand-eye poses, (n, 6) rad.
    """

    seed: int
    truth: Truth
    arm: RealArm | None
    noise_px: float
    size: float
    inwards_px: float
    joints: Array

    def rng(self, what: int) -> np.random.Generator:
        """Generator of a part of the world."""
        return np.random.default_rng([self.seed, 41, what])


@dataclass(frozen=True, eq=False)
class PlacedCube:
    """Where a cube was released.

    Attributes:
        off: of the tool's tip from the hole's axis, in the hole's frame, (2,) m.
        q: readings, (6,) rad.
        hole: index.
    """

    off: Array
    q: Array
    hole: int


@dataclass(frozen=True, eq=False)
class Placed:
    """What came of a world.

    Attributes:
        found: the hand-eye calibration.
        T_base_board: true pose of the board that cubes are placed on.
        board_corners, holes: of that board as its CSV says, (2, 4, 3) and (4, 3) m.
        cubes: in the order of the plan.
    """

    found: HandEye
    T_base_board: Array
    board_corners: Array
    holes: Array
    cubes: tuple[PlacedCube, ...]


class Refused(Exception):
    """A step that a465 refuses, and why."""


def drawn(seed: int, real: bool) -> World:
    """Draw a world: `real` for an arm that scatters, runs out of true and sags."""
    rng = np.random.default_rng([seed, 40])
    truth = draw_truth(rng)
    noise = float(np.exp(rng.uniform(*np.log(NOISE_PX))))
    size, inwards = 1e-3 * rng.standard_normal(), 0.1 * rng.standard_normal()
    joints = postures(Case(poses=POSES, target=TARGET, sampler="planned"), truth, rng, CANDIDATES)
    arm = draw_real_arm(rng, truth) if real else None
    return World(seed, truth, arm, noise, size, inwards, joints)


def placed(world: World, folder: Path) -> Placed:
    """Calibrate the world's lens and arm, look, plan, and move; files are written to `folder`.

    Raises:
        Refused: by one of these steps.
    """
    lens = calibrate_camera(photos(_views(world)), CHARUCO, LENS.size)
    if not lens.accepted:
        raise Refused(f"lens: {'; '.join(lens.reasons)}")
    camera = replace(lens.camera, lens_covariance=lens.covariance)
    recording = replace(_recorded(world), camera=camera)
    try:
        found = calibrate_hand_eye(replace(recording, unit=UNIT))
    except CalibrationRefused as error:
        raise Refused(f"hand-eye: {error}") from error
    if not found.chain.accepted:
        raise Refused(f"hand-eye: {'; '.join(found.chain.reasons)}")
    try:
        return _planned(world, found, folder)
    except A465Error as error:
        raise Refused(f"plan: {error}") from error


def _planned(world: World, found: HandEye, folder: Path) -> Placed:
    files = draw_world("task2", world.seed, data_file("scenes"), folder)
    true_boards = read_world(files.world, 0.036).boards
    task = _calibrated(files.task, found, folder)
    rng, boards, made = world.rng(3), [], {}
    for board, cubes in zip(task.boards, (True, False), strict=True):
        T = next(b for b in true_boards if b.board.name == board.name).T_base_board
        markers = board.marker_corners() + _aside(rng, 2)[:, None]
        made[board.name] = T, board.holes + _aside(rng, 4)
        true_px = LENS.at(world.truth.T_base_camera).project_base(apply(T, markers))
        frames = [
            [
                Marker(i, frozen(px), "lines")
                for i, px in zip(board.marker_ids, _noisy(true_px, world, rng), strict=True)
            ]
            for _ in range(FRAMES)
        ]
        pose = estimate_board_pose(board, frames, task.cell.camera, task.cell.board_limits, task.cell.tilts)
        boards.append(ObservedBoard(pose, (Occupancy("cube" if cubes else "empty"),) * 4))
    plan = plan_rest(Rest(task, Observation(tuple(boards)), task.cell.q_start, task.cell.speed))
    if plan is None:
        raise RuntimeError("four cubes to move, and nothing to plan")
    target = task.boards[1]
    T_target, holes = made[target.name]
    cubes_at = tuple(_released(world, plan, T_target, holes, rng))
    return Placed(found, T_target, target.marker_corners(), target.holes, cubes_at)


def _released(
    world: World, plan: Plan, T_base_board: Array, holes: Array, rng: np.random.Generator
) -> list[PlacedCube]:
    unit, released, held = load_unit(UNIT), [], False
    counts: tuple[int, ...] = ()
    for step in plan.steps:
        if isinstance(step, Move):
            counts = step.path.end
        elif isinstance(step, GripperStep):
            if held and step.action == "open":
                q = unit.positions(counts)
                at = q[None] if world.arm is None else world.arm.rest(q[None], rng)
                T = world.truth.T_base_gripper(at)[0] @ TOOL
                off = (T[:3, 3] - apply(T_base_board, holes)) @ T_base_board[:3, :3]
                hole = int(np.argmin(np.linalg.norm(off, axis=1)))
                released.append(PlacedCube(off[hole, :2], q, hole))
            held = step.action != "open"
    return released


def _calibrated(task_file: Path, found: HandEye, folder: Path) -> Task:
    """The drawn task in a cell with the calibration, all read from files as a user's are."""
    scenes = data_file("scenes")
    write_camera(folder / "camera.toml", found.recording.camera.at(found.T_base_camera))
    write_arm_calibration(folder / "calibration.toml", arm_calibration(found))
    cell = (scenes / "cell.toml").read_text().replace("boards/", f"{scenes}/boards/")
    cell = cell.replace(
        'camera = "cameras/lab.toml"', 'calibration = "calibration.toml"\ncamera = "camera.toml"'
    )
    cell = cell.replace("made_within_mm = 0.1", f"made_within_mm = {2e3 * MADE}")
    (folder / "cell.toml").write_text(cell)
    task_file.write_text(task_file.read_text().replace(f'"{scenes / "cell.toml"}"', '"cell.toml"'))
    return read_task(task_file)


def _views(world: World) -> list[TargetView]:
    rng = world.rng(1)
    poses = random_poses(LENS, CHARUCO, rng, VIEWS)
    return [seen(T, rng, world.noise_px, lens=LENS) for T in poses]


def _recorded(world: World) -> ArmRecording:
    rng, truth = world.rng(2), world.truth
    at = world.joints if world.arm is None else world.arm.rest(world.joints, rng)
    recording = recorded(truth, world.joints, TARGET, rng)
    points = TARGETS[TARGET]
    clean = truth.pixels(at, (1.0 + world.size) * points)
    towards = clean.mean(axis=1, keepdims=True) - clean
    clean += world.inwards_px * towards / np.linalg.norm(towards, axis=-1, keepdims=True)
    return replace(recording, pixels=frozen(np.array([_noisy(px, world, rng) for px in clean])))


def _noisy(px: Array, world: World, rng: np.random.Generator) -> Array:
    """Corners of one image: noise of each, and what is left of the camera's sway."""
    sway = SWAY_PX * rng.standard_normal(2)
    return np.asarray(px + sway + world.noise_px * rng.standard_normal(px.shape))


def _aside(rng: np.random.Generator, count: int) -> Array:
    return np.column_stack([MADE * rng.standard_normal((count, 2)), np.zeros(count)])
