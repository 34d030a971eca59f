"""Clearances of a plan's moves for every likely error of the arm, and the refusal of one that is too small."""

from __future__ import annotations

import numpy as np

from arm.controller.unit import Unit
from arm.errors import ImpossibleError
from arm.plan_file import Move, Plan
from cell.accuracy.arm_errors import arm_errors
from cell.config.cell import Cell
from plan.collision.bezier import curve_of_counts
from plan.collision.certificate import ArmErrors, bounds_with_errors, certify_move
from plan.collision.world import World
from plan.scene import scene_from_json
from plan.verify import move_scenes


def erring_clearances(cell: Cell, plan: Plan) -> tuple[float, ...]:
    """Prove the clearance of every move of a plan for an arm with its errors; require `accuracy.least_clearance_mm`.

    The errors are taken off the proved clearance of each segment. Only where that leaves too little, the move is
    certified anew, which knows by how much the errors move each pair.

    Args:
        cell: the cell of the plan.
        plan: with its scene.

    Returns:
        Per move, m; empty if the arm's errors are not known.

    Raises:
        ImpossibleError: a move may come too near; data: step, pair, clearance_mm, required_mm.
    """
    errors = arm_errors(cell)
    if errors is None:
        return ()
    scene = scene_from_json(plan.scene, cell.robot(), cell.robot(cell.cube_size))
    scenes = move_scenes(plan, scene, cell.unit)
    return tuple(
        _clearance(move, world, cell.unit, errors, cell.erring_clearance) for move, world, _ in scenes
    )


def _clearance(move: Move, world: World, unit: Unit, errors: ArmErrors, least: float) -> float:
    curve = curve_of_counts(move.path, unit)
    stated = (
        move.clearances
        if len(move.clearances) == len(curve.control)
        else [move.clearance] * len(curve.control)
    )
    bound = float(bounds_with_errors(world, curve, np.array(stated), errors).min())
    if bound >= least:
        return bound
    certificate = certify_move(world, move.path, unit, least, errors=errors)
    if not certificate.proved:
        kept, lost = 1e3 * certificate.clearance, 1e3 * (move.clearance - certificate.clearance)
        raise ImpossibleError(
            f"{move.name!r} keeps {kept:.1f} mm between {' and '.join(certificate.pair)} for all errors of the arm "
            f"within {errors.sigmas:g} standard deviations, but accuracy.least_clearance_mm is {1e3 * least:g}: "
            f"the errors take off {lost:.1f} mm; raise motion.clearance_mm by as much, or calibrate the arm again",
            step=move.name,
            pair=list(certificate.pair),
            clearance_mm=kept,
            required_mm=1e3 * least,
        )
    return certificate.clearance
