"""Clearances of a plan's moves for every likely error of the arm, and the refusal of one that is too small."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from math import floor

import numpy as np

from arm.controller.unit import Unit
from arm.errors import ImpossibleError
from arm.plan_file import Plan
from arm.robot.jaws import after_closing
from arm.robot.shapes import Body
from arm.se3 import Array
from cell.accuracy.arm_errors import arm_errors, body_errors
from cell.config.cell import Cell
from plan.collision.bezier import curve_of_counts
from plan.collision.certificate import ArmErrors, certify_move, moved_by_errors
from plan.collision.world import World
from plan.scene import Scene, scene_from_json
from plan.verify import ON_LINES, MoveScene, scenes_of_moves
from vision.observation import Observation


def erring_clearances(
    cell: Cell,
    plan: Plan,
    seen: Observation | None = None,
    begins_with: str | None = None,
    jaws_unknown: bool = False,
) -> tuple[float, ...]:
    """Prove the clearance of every move of a plan for an arm with its errors; require `accuracy.least_clearance_mm`.

    The errors are taken off the proved clearance of each segment. Only where that leaves too little, the move is
    certified anew, which knows by how much the errors move each pair.

    Args:
        cell: the cell of the plan.
        plan: with its scene.
        seen: look that the plan was made from; then the errors of its boards and cubes are taken off too. Those of
            parts, which the arm itself puts down, always are.
        begins_with: name of the cube that is in the jaws before the first step.
        jaws_unknown: whether the plan was made for jaws of any opening.

    Returns:
        Per move, m; empty if the arm's errors are not known.

    Raises:
        ImpossibleError: a move may come too near; data: step, pair, clearance_mm, required_mm.
    """
    errors = arm_errors(cell)
    if errors is None:
        return ()
    any_jaws = after_closing(cell.robot())
    arms = (any_jaws, any_jaws) if jaws_unknown else (cell.robot(), cell.robot_holding())
    scene = scene_from_json(plan.scene, *arms)
    off = {} if seen is None else body_errors(cell, seen, plan, scene)
    exact = list(scenes_of_moves(plan, scene, cell.unit, begins_with))
    lost = _lost(exact, cell.unit, errors)
    for name, by in _handling_errors(exact, lost, scene).items():
        off[name] = off.get(name, 0.0) + by
    scene = replace(scene, bodies=_grown(scene.bodies, off), cubes=_grown(scene.cubes, off))
    scenes = list(scenes_of_moves(plan, scene, cell.unit, begins_with))
    bounds = _bounds(scenes, lost, off)
    least = cell.erring_clearance
    return tuple(
        bound
        if bound >= least
        else _proved(
            of,
            bound,
            cell.unit,
            errors,
            least,
            "arm and boards" if off else "the arm",
            _own_clearance(of, plan),
        )
        for of, bound in zip(scenes, bounds, strict=True)
    )


def _grown(bodies: Sequence[Body], off: Mapping[str, float]) -> tuple[Body, ...]:
    """Bodies with larger paddings: no point of one is further from where it should be."""
    return tuple(replace(b, padding=b.padding + off[b.name]) if b.name in off else b for b in bodies)


def _lost(scenes: Sequence[MoveScene], unit: Unit, errors: ArmErrors) -> list[Array]:
    """How far errors may move any body of the arm during each segment of each move, m."""
    curves = [curve_of_counts(of.move.path, unit) for of in scenes]
    alike: dict[tuple[int, bytes], list[int]] = {}  # moves of the same arm with the same body in its jaws
    for index, of in enumerate(scenes):
        held = b"" if of.held is None else of.held[0].name.encode() + of.held[1].tobytes()
        alike.setdefault((id(of.robot), held), []).append(index)
    found = [np.zeros(0)] * len(scenes)
    for indices in alike.values():
        first = scenes[indices[0]]
        world = World(first.robot, (), *(first.held or (None, None)))
        moved = moved_by_errors(world, [curves[i] for i in indices], errors)
        for index, lost in zip(indices, moved, strict=True):
            found[index] = lost
    return found


def _handling_errors(scenes: Sequence[MoveScene], lost: Sequence[Array], scene: Scene) -> dict[str, float]:
    """How far supplied cubes may be from where a plan has them, m: by the arm's errors where it takes and puts them."""
    supplied, found = {name for supply in scene.supplies for name in supply}, dict[str, float]()
    for (before, after), moved in zip(pairwise(scenes), lost, strict=False):
        taken, put = after.move.held, before.move.held
        for name in (taken, put) if taken != put else ():
            if name is not None and name in supplied:
                found[name] = found.get(name, 0.0) + float(moved[-1])
    return found


def _bounds(scenes: Sequence[MoveScene], lost: Sequence[Array], off: Mapping[str, float]) -> list[float]:
    """Proved clearance of each move less what the errors may move any two bodies of it, m."""
    bounds, most = [], max(off.values(), default=0.0)
    for of, moved in zip(scenes, lost, strict=True):
        stated = of.move.clearances if len(of.move.clearances) == len(moved) else of.move.clearance
        in_jaws = 0.0 if of.move.held is None else off.get(of.move.held, 0.0)
        bounds.append(float((stated - moved).min()) - in_jaws - most)
    return bounds


def _own_clearance(of: MoveScene, plan: Plan) -> bool:
    """Whether a move is a line whose required clearance is not motion.clearance_mm: those of a task with cubes."""
    options = plan.provenance.get("options", {})
    for_all = options.get("line_clearance") == options.get("clearance") and options.get("look") == "never"
    return of.move.role in ON_LINES and not for_all


def _advice(kept: float, least: float, own_clearance: bool) -> str:
    """Say which keys give a move that keeps `kept` the clearance `least`, mm."""
    if not own_clearance:
        return f"raise motion.clearance_mm by {least - kept:.1f}, or calibrate the arm again"
    lower = floor(10.0 * kept) / 10.0
    why = "(motion.clearance_mm does not act on an approach or retract)"
    lowered = f"lower it to {lower:g} or less {why}, or calibrate the arm again"
    return lowered if lower > 0.0 else f"calibrate the arm again {why}"


def _proved(
    of: MoveScene,
    bound: float,
    unit: Unit,
    errors: ArmErrors,
    least: float,
    who: str,
    own_clearance: bool,
) -> float:
    """Certify a move with errors, which requires `least`; `bound` is what is proved of it already, m."""
    move = of.move
    certificate = certify_move(of.world(), move.path, unit, least, errors=errors)
    if not certificate.proved:
        # the certificate ends where it is refuted, and then proves nothing of the rest
        kept = 1e3 * max(bound, certificate.clearance)
        raise ImpossibleError(
            f"{move.name!r} keeps {1e3 * move.clearance:.1f} mm, but for all errors of {who} within "
            f"{errors.sigmas:g} standard deviations only {kept:.1f} mm between {' and '.join(certificate.pair)}, and "
            f"accuracy.least_clearance_mm is {1e3 * least:g}; {_advice(kept, 1e3 * least, own_clearance)}",
            step=move.name,
            pair=list(certificate.pair),
            clearance_mm=kept,
            required_mm=1e3 * least,
            **of.world().state(unit.positions(move.path.at([certificate.time]))[0]),
        )
    return max(bound, certificate.clearance)
