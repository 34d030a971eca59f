"""``a465 doctor``: five seconds in which what everything rests on is done once: a motion, a look, a unit."""

from __future__ import annotations

import numpy as np

from arm.errors import ImpossibleError
from arm.io.storage import data_file
from arm.se3 import apply
from cell.config.cell import Cell
from cell.config.cell_file import read_cell
from cell.doctor.devices import ask
from cell.doctor.finding import OK, Finding
from cell.files.world import board_placement
from cell.scene.bodies import plate_body
from cell.scene.build import unseen_scene
from driver.emulator import Emulator
from driver.line.clock import Clock
from plan.options import PlanOptions
from plan.pick_place.go_to import plan_way
from plan.verify import replay
from render.renderer import PlacedBoard, render, with_noise
from vision.boards.pose import estimate_board_pose
from vision.markers.detect import detect_markers

TURN = np.radians(5.0)  # of J6: hardly any body comes nearer to another
HOLE_LIMIT = 0.1e-3  # how far a hole may be found from where it is, m; three times what this one gives
NOISE_GREY = 2.0


def motion_finding(cell: Cell) -> Finding:
    """Plans J6 away from q_start in this cell, and judges the plan anew as it would be sent.

    Raises:
        ImpossibleError: something is too near to where the looks are taken from, or the plan does not hold.
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
    plan = plan_way(scene, cell.q_start, q_to, unit, limits, options)
    if plan is None:
        raise ImpossibleError("a turn of J6 by 5 deg was planned as no motion at all", joint="J6")
    moves = replay(plan, scene, unit, limits)
    clearance = min(m.check.clearance for m in moves)
    pair = min(moves, key=lambda m: m.check.clearance).check.pair
    return Finding(
        "self-test: plan",
        OK,
        f"J6 by 5 deg from q_start in {plan.duration_s:.2f} s, certified and checked: {1e3 * clearance:.1f} mm "
        f"({' - '.join(pair)})",
        "",
        {"motion_s": plan.duration_s, "clearance_mm": 1e3 * clearance, "closest": list(pair)},
    )


def look_finding() -> Finding:
    """Renders a board before the built-in scene's camera and finds it.

    Raises:
        ImpossibleError: it is not found, or not where it is.
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
    found = f"a rendered board's holes were found {1e3 * worst:.3f} mm from where they are"
    if worst > HOLE_LIMIT:
        raise ImpossibleError(f"{found}, more than {1e3 * HOLE_LIMIT:g} mm", off_m=worst, limit_m=HOLE_LIMIT)
    return Finding("self-test: look", OK, found, "", {"off_mm": 1e3 * worst})


def unit_finding(cell: Cell) -> Finding:
    """Asks an emulated unit of this cell's kind on a pseudo-terminal, as a real one is asked.

    Raises:
        InputError: it does not answer, or there is no pseudo-terminal.
        ExecutionStopped: it does not answer.
    """
    unit = cell.nominal_unit
    with Emulator(unit, Clock()) as emulator:
        told = ask(emulator.open_pty(), unit.firmware)
    found = f"an emulated {unit.name} on a pseudo-terminal answers in {1e3 * told.answer_s:.0f} ms"
    return Finding("self-test: unit", OK, found, "", told.to_json())
