"""Clearances of a plan's moves for every likely error of the arm, and the refusal of one that is too small."""

from __future__ import annotations

from arm.errors import ImpossibleError
from arm.plan_file import Plan
from cell.accuracy.arm_errors import arm_errors
from cell.config.cell import Cell
from plan.collision.certificate import ClearanceCertificate, certify_move
from plan.scene import scene_from_json
from plan.verify import move_scenes


def erring_clearances(cell: Cell, plan: Plan) -> tuple[ClearanceCertificate, ...]:
    """Certify every move of a plan for an arm with its errors, and require `accuracy.least_clearance_mm`.

    Args:
        cell: the cell of the plan.
        plan: with its scene.

    Returns:
        A certificate per move, to 5 % or 0.5 mm; empty if the arm's errors are not known.

    Raises:
        ImpossibleError: a move may come too near; data: step, pair, clearance_mm, required_mm.
    """
    errors = arm_errors(cell)
    if errors is None:
        return ()
    found = []
    least, scene = (
        cell.erring_clearance,
        scene_from_json(plan.scene, cell.robot(), cell.robot(cell.cube_size)),
    )
    for move, setting in move_scenes(plan, scene, cell.unit):
        certificate = certify_move(setting.world, move.path, cell.unit, least, errors=errors)
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
        found.append(certificate)
    return tuple(found)
