"""The errors of a calibrated arm, and of boards and cubes, that certificates allow for.

They are those of the budget of a placement, each within its own ellipsoid of `accuracy.sigmas` standard deviations. The
bounds of arm and boards are added: no two errors inside their ellipsoids do more together, however they are correlated
(through the camera's pose, for one).
"""

from __future__ import annotations

import numpy as np

from arm.board import plate_name
from arm.calibration_file import COVARIANCE
from arm.numerics.products import mul, norm
from arm.plan_file import Plan
from arm.poses import adjoint
from arm.robot.dh import A465
from arm.robot.gripper import Gripper
from arm.robot.shapes import Body
from arm.se3 import Array, apply, frozen, inverse, skew
from cell.accuracy.error_model import ErrorModel
from cell.accuracy.linear_error import LinearError
from cell.accuracy.placement import grip_error, gripper_positions, hole_of
from cell.config.cell import Cell
from cell.program.points import WORK
from plan.collision.certificate import ArmErrors
from plan.collision.covers import hull
from plan.scene import Scene
from vision.observation import Observation

_BODY = 0.15  # m, from the tool's frame to the furthest point of a held cube or of the gripper
_OFFSETS = slice(COVARIANCE[0], sum(COVARIANCE[:2]))
_LINKS = slice(sum(COVARIANCE[:2]), sum(COVARIANCE[:5]))


def arm_errors(cell: Cell) -> ArmErrors | None:
    """Return the errors of a cell's arm at `accuracy.sigmas` standard deviations; None without a calibration.

    Joints err by their offsets (the calibration's covariance), by what they scatter, and by the error at rest. Errors
    of d and a move what lies behind them by themselves, those of alpha by their distance from the joint, at most the
    length of the arm from there.
    """
    made = cell.calibration
    if made is None or made.covariance is None or cell.sigmas == 0.0:
        return None
    scatter = np.zeros(6) if made.scatter is None else made.scatter
    joints = made.covariance[_OFFSETS, _OFFSETS] + np.diag(scatter**2 + cell.following_error**2)
    lever = np.concatenate([np.ones(2 * A465.joints), _length_behind(cell)])
    links = float(lever @ np.abs(made.covariance[_LINKS, _LINKS]) @ lever)
    return ArmErrors(frozen(joints), cell.sigmas, cell.sigmas * float(np.sqrt(links)))


def body_errors(cell: Cell, seen: Observation, plan: Plan, scene: Scene) -> dict[str, float]:
    """Return how far boards, stands, cubes and bodies of a workpiece may be from where a plan has them, m, by name.

    A cube counts as off by the largest of what it may be off in its hole, in the jaws, and where it is released. In the
    jaws that is relative to the tool, whose own errors are those of the arm.

    Args:
        cell: of the plan.
        seen: look that the plan was made from; boards that it lacks, and what stands on them, have no errors.
        plan: whose jaws take and release the cubes.
        scene: of the plan.
    """
    if cell.sigmas == 0.0 or not ErrorModel.available(cell):
        return {}
    model = ErrorModel.of(cell, scene.robot_open)
    boards = {pose.board.name: model.board(pose) for pose in seen.poses}
    found: dict[str, float] = {}
    for body in (*scene.bodies, *scene.cubes):
        board = boards.get(_board_of(body, scene, plan))
        if board is not None:
            T_body_base = inverse(body.T_base_body)
            found[body.name] = _largest(board.shared.transformed(adjoint(T_body_base)), body, cell.sigmas)
    at, cubes = gripper_positions(cell, plan), {cube.name: cube for cube in scene.cubes}
    for number, entry in enumerate(plan.task.get("cubes", ())):
        source, cube, q = hole_of(boards, entry["from"]), cubes.get(entry["cube"]), at.get((number, "close"))
        if source is not None and cube is not None and q is not None:
            T_cube_tool = mul(inverse(cube.T_base_body), model.T_base_tool(q))
            errors = [grip_error(model, *source, q).transformed(adjoint(T_cube_tool))]
            if (q_release := at.get((number, "open"))) is not None:
                T_cube_base = mul(T_cube_tool, inverse(model.T_base_tool(q_release)))
                errors.append(errors[0] + model.tool_error(q_release).transformed(adjoint(T_cube_base)))
                if (target := hole_of(boards, entry["to"])) is not None:  # it moves with the pocket
                    errors.append(target[0].shared.transformed(adjoint(T_cube_base)))
            off = max(_largest(error, cube, cell.sigmas) for error in errors)
            found[cube.name] = max(found.get(cube.name, 0.0), off)
    return found


def _board_of(body: Body, scene: Scene, plan: Plan) -> str:
    """Name of the board of ``plate 01-02`` or ``stand 01-02``, or of the one with a cube or the workpiece on it.

    A cube has the name of the hole that it came from, and stands on the nearest plate of those that it touches.
    """
    if body.kind == WORK:
        return str(plan.task.get("board", ""))
    plates = (b for b in scene.bodies if b.name.startswith(plate_name("")))
    touched = [plate for plate in plates if frozenset((plate.name, body.name)) in scene.allowed]
    of = min(touched, key=lambda b: float(norm(b.T_base_body[:3, 3] - body.T_base_body[:3, 3])), default=body)
    return of.name.partition(" ")[2]


def _largest(error: LinearError, body: Body, sigmas: float) -> float:
    """Largest displacement of a point of a body by an error of its own frame within so many standard deviations, m.

    A twist (v, w) moves a point p along a screw, at the constant speed |v + w x p|, so by no more than that. Over the
    ellipsoid of v and w the largest such speed is convex in p, so of a hull it is at a corner; in a ball about a corner
    it is larger by at most |w| times the radius.
    """
    (corners, radius), C = hull(body.shape), error.covariance
    J = np.array([np.hstack([np.eye(3), -skew(corner)]) for corner in corners])
    square = float(np.linalg.eigvalsh(J @ C @ np.swapaxes(J, 1, 2))[:, -1].max())
    turn = float(np.linalg.eigvalsh(C[3:, 3:])[-1])
    return sigmas * float(np.sqrt(max(square, 0.0)) + radius * np.sqrt(max(turn, 0.0)))


def _length_behind(cell: Cell) -> Array:
    """Largest distance of any point of arm, tool and cube from the frame behind each joint, (6,) m."""
    links = np.hypot(A465.a, A465.d)
    behind = np.cumsum(links[::-1])[::-1] - links
    return np.asarray(behind + _tool_length(cell))


def _tool_length(cell: Cell) -> float:
    """Largest distance of any point of the tool, and of a cube in it, from the flange's centre, m."""
    tool = cell.tool
    if isinstance(tool, Gripper):
        return tool.length + _BODY
    far = [0.0]
    for body in tool.bodies:
        points, radius = hull(body.shape)
        far.append(radius + max(float(norm(at)) for at in apply(body.T_base_body, points)))
    return max(far)
