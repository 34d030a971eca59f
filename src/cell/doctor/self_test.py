"""``a465 doctor``: a self-test of five seconds that plans a motion, detects a board and talks to an emulated unit."""

from __future__ import annotations

import numpy as np

from arm.errors import ImpossibleError
from arm.io.storage import data_file
from arm.se3 import apply
from cell.config.cell import Cell
from cell.config.cell_file import read_cell
from cell.doctor.devices import ask
from cell.doctor.finding import OK, CheckResult
from cell.files.world import board_placement
from cell.scene.bodies import plate_body
from cell.scene.build import unseen_scene
from driver.emulator import Emulator
from driver.line.clock import Clock
from plan.options import PlanOptions
from plan.program.go_to import plan_joint_motion
from plan.verify import replay
from render.renderer import PlacedBoard, render, with_noise
from vision.boards.pose import estimate_board_pose
from vision.markers.detect import detect_markers

TURN = np.radians(5.0)  # rotation of J6: it hardly changes any clearance
HOLE_LIMIT = 0.1e-3  # largest error of a detected hole, m; three times the error in this image
NOISE_GREY = 2.0


def check_motion(cell: Cell) -> CheckResult:
    """Plan a motion of J6 away from q_start in this cell, and verify the plan as it would be sent.

    Raises:
        ImpossibleError: a body is too close to the arm at q_start, or the plan is invalid.
    """
    unit, limits, scene = cell.unit, cell.limits, unseen_scene(cell)
    q_to = np.array(cell.q_start)
    q_to[5] += TURN if q_to[5] < (unit.lower[5] + unit.upper[5]) / 2.0 else -TURN
    options = PlanOptions(
        speed=cell.speed,
        velocity_fraction=cell.velocity_fraction,
        acceleration_fraction=cell.acceleration_fraction,
        clearance=cell.clearance,
        jerk_time=cell.jerk_time,
    )
    plan = plan_joint_motion(scene, cell.q_start, q_to, unit, limits, options)
    if plan is None:
        raise ImpossibleError("a rotation of J6 by 5 deg was planned as no motion at all", joint="J6")
    moves = replay(plan, scene, unit, limits)
    closest = min(moves, key=lambda m: m.check.clearance).check
    clearance, pair = closest.clearance, closest.pair
    found = (
        f"J6 by 5 deg from q_start in {plan.duration_s:.2f} s, certified and checked: {1e3 * clearance:.1f} mm "
        f"({' - '.join(pair)})"
    )
    data = {"motion_s": plan.duration_s, "clearance_mm": 1e3 * clearance, "closest": list(pair)}
    return CheckResult("self-test: plan", OK, found, "", data)


def check_detection() -> CheckResult:
    """Render a board before the built-in scene's camera and detect it.

    Raises:
        ImpossibleError: the board is not detected, or at a wrong pose.
    """
    cell = read_cell(data_file("scenes/cell.toml"))
    board, camera = cell.boards[0], cell.camera
    T_base_board = board_placement((0.44, -0.01, 0.06), *np.radians([40.0, 7.0, 100.0]))
    bodies = [*cell.fixed, plate_body(board.name, T_base_board)]
    clean = render(camera, bodies, [PlacedBoard(board, T_base_board)], cell.dictionary)
    image = with_noise(clean, np.random.default_rng(0), NOISE_GREY)
    pose = estimate_board_pose(board, [detect_markers(image, camera, cell.dictionary)], camera)
    off = apply(pose.T_base_board, board.holes) - apply(T_base_board, board.holes)
    worst = float(np.linalg.norm(off, axis=1).max())
    found = f"holes of a rendered board were detected with an error of {1e3 * worst:.3f} mm"
    if worst > HOLE_LIMIT:
        raise ImpossibleError(f"{found}, more than {1e3 * HOLE_LIMIT:g} mm", off_m=worst, limit_m=HOLE_LIMIT)
    return CheckResult("self-test: look", OK, found, "", {"off_mm": 1e3 * worst})


def check_unit(cell: Cell) -> CheckResult:
    """Identify an emulated unit of this cell's kind on a pseudo-terminal, like a real one.

    Raises:
        InputError: the unit does not answer, or there is no pseudo-terminal.
        ExecutionStopped: the link is lost.
    """
    unit = cell.nominal_unit
    with Emulator(unit, Clock()) as emulator:
        answer = ask(emulator.open_pty(), unit.firmware)
    found = f"an emulated {unit.name} on a pseudo-terminal answers in {1e3 * answer['answer_s']:.0f} ms"
    return CheckResult("self-test: unit", OK, found, "", answer)
