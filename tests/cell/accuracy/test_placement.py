"""The budget of a placement is the derivative of the true kinematics, camera and grip by every error."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest

from arm.numerics.products import mul
from arm.poses import BoardPose, adjoint
from arm.robot.dh import A465
from arm.robot.link_errors import LinkErrors, with_link_errors
from arm.robot.model import Robot
from arm.se3 import Array, inverse, moved, rot_x, rot_z, rotation_vector, transform
from calib.model.intrinsics import camera_of, vector_of
from cell.accuracy.error_model import BoardError, ErrorModel
from cell.accuracy.insertion import PocketFit
from cell.accuracy.placement import GRIP_PROJECTION, Transfer, placement_budget, placement_error
from cell.config.cell import Cell
from plan.kinematics.ik import inverse_kinematics
from vision.camera.projection import Projection

FIT = PocketFit(0.040, 0.044, 5e-5)
STEP = 1e-5
ERRORS = {"shared": 39, "tool": 3, "grip": 6, "release": 6, "source": 6, "target": 6, "from": 2, "to": 2}
"""Number of errors by what they act on."""
SHARED = {
    "camera pose": slice(0, 6),
    "joint offsets": slice(6, 12),
    "links": slice(12, 30),
    "lens": slice(30, 39),
}


def _board(cell: Cell, name: str, x: float, y: float, tilt: float, yaw: float) -> BoardPose:
    board = next(b for b in cell.boards if b.name == name)
    root = np.diag([5e-5, 6e-5, 4e-4, 3e-3, 3e-3, 4e-4])
    T_base_board = transform(rot_z(yaw) @ rot_x(tilt), (x, y, 0.05))
    return BoardPose(board, T_base_board, root @ root, 0.1, 9.0, None, 0.25 * root @ root)


def _q(cell: Cell, hole: Array, yaw: float) -> Array:
    grip = mul(hole, transform(mul(rot_x(np.pi), rot_z(yaw)), (0.0, 0.0, 0.015)))
    return inverse_kinematics(cell.robot(), grip, cell.unit.lower, cell.unit.upper).q[0]


@dataclass(frozen=True, eq=False)
class Case:
    """A placement whose errors can be stated: one array per group, by what it acts on."""

    cell: Cell
    model: ErrorModel
    transfer: Transfer
    nominal: Robot

    @classmethod
    def of(cls, cell: Cell) -> Case:
        model = ErrorModel.of(cell)
        source = model.board(_board(cell, "01-02", 0.40, 0.05, 0.0, 0.3))
        target = model.board(_board(cell, "03-04", 0.45, -0.22, 0.2, -0.6))
        holes = [
            mul(of.pose.T_base_board, of.pose.board.T_board_hole(k)) for of, k in ((source, 1), (target, 2))
        ]
        q_grip, q_release = _q(cell, holes[0], 0.0), _q(cell, holes[1], np.pi / 2.0)
        return cls(
            cell, model, Transfer("cube", (source, 1), (target, 2), q_grip, q_release), cell.nominal_robot()
        )

    def true_arm(self, q: Array, shared: Array, joints: Array, tool: Array) -> Array:
        offsets, d, a, alpha = shared[6:30].reshape(4, 6)
        made = self.model.calibration.links
        links = LinkErrors(made.d + d, made.a + a, made.alpha + alpha)
        robot = with_link_errors(self.nominal, A465, links)
        return mul(robot.T_base_tool(q + offsets + joints), transform(t=tool))

    def true_hole(self, of: BoardError, index: int, shared: Array, board: Array, in_plane: Array) -> Array:
        """The camera sees the same pixels, through another lens and from elsewhere."""
        camera, pose = self.cell.camera, of.pose
        points = pose.board.marker_corners().reshape(-1, 3)
        T = mul(inverse(camera.T_base_camera), pose.T_base_board)
        pixels = Projection(camera.at(np.eye(4)), T, points).pixels
        true = camera_of(vector_of(camera) + shared[30:], camera.size)
        for _ in range(4):
            now = Projection(true, T, points)
            T = moved(
                T, np.linalg.lstsq(now.by_target.reshape(-1, 6), (pixels - now.pixels).ravel(), rcond=None)[0]
            )
        T_base_board = mul(moved(camera.T_base_camera, shared[:6]), moved(T, board))
        return mul(T_base_board, mul(pose.board.T_board_hole(index), transform(t=(*in_plane, 0.0))))

    def off(self, errors: dict[str, Array]) -> Array:
        """Twist of the released cube in the target hole's frame, (6,)."""
        e = {name: np.zeros(count) for name, count in ERRORS.items()} | errors
        t = self.transfer
        grip = self.true_arm(t.q_grip, e["shared"], e["grip"], e["tool"])
        release = self.true_arm(t.q_release, e["shared"], e["release"], e["tool"])
        source = self.true_hole(*t.source, e["shared"], e["source"], e["from"])
        target = self.true_hole(*t.target, e["shared"], e["target"], e["to"])
        nominal = self.model.T_base_tool(t.q_release)
        T_tool_cube = mul(inverse(self.model.T_base_tool(t.q_grip)), self._hole(*t.source))
        seen = mul(inverse(grip), source)
        held = mul(_exp(GRIP_PROJECTION @ _log(mul(seen, inverse(T_tool_cube)))), T_tool_cube)
        released = _log(mul(mul(release, held), inverse(mul(nominal, T_tool_cube))))
        hole = self._hole(*t.target)
        return adjoint(inverse(hole)) @ (released - _log(mul(target, inverse(hole))))

    def _hole(self, of: BoardError, index: int) -> Array:
        return mul(of.pose.T_base_board, of.pose.board.T_board_hole(index))


def _log(T: Array) -> Array:
    return np.append(T[:3, 3], rotation_vector(T[:3, :3]))  # of a small motion


def _exp(twist: Array) -> Array:
    return moved(np.eye(4), twist)


def _derivative(case: Case, name: str, count: int) -> Array:
    scale = np.ones(count)
    if name == "shared":
        scale[30:] = (1e2, 1e2, 1e2, 1e2, 1e1, 1e2, 1e0, 1e0, 1e3)  # px and coefficients, not m and rad
    columns = []
    for step in np.diag(STEP * scale):
        change = case.off({name: step}) - case.off({name: -step})
        columns.append(change / (2.0 * step.max()))
    return np.stack(columns, axis=1)


def _exact(case: Case) -> tuple[dict[str, Array], Array]:
    """Covariance of every source alone, and of all, by derivatives of the true placement."""
    model, t = case.model, case.transfer
    D = {name: _derivative(case, name, count) for name, count in ERRORS.items()}
    scatter, follows = model.calibration.scatter, model.cell.following_error
    assert scatter is not None
    found = {
        name: D["shared"][:, of] @ model.shared.covariance[of, of] @ D["shared"][:, of].T
        for name, of in SHARED.items()
    }
    found["tool"] = D["tool"] @ model.tool.covariance @ D["tool"].T
    found["repeatability"] = sum((D[n] * scatter**2 @ D[n].T for n in ("grip", "release")), np.zeros((6, 6)))
    found["following"] = sum((follows**2 * D[n] @ D[n].T for n in ("grip", "release")), np.zeros((6, 6)))
    found["detection"], found["board and print"] = np.zeros((6, 6)), np.zeros((6, 6))
    for name, plane, (of, _) in (("source", "from", t.source), ("target", "to", t.target)):
        again, made = of.pose.repeatability, of.pose.board.tolerance / 2.0
        assert again is not None
        found["detection"] += D[name] @ again @ D[name].T
        found["board and print"] += D[name] @ (of.pose.covariance - again) @ D[name].T
        found["board and print"] += made**2 * D[plane] @ D[plane].T
    whole = D["shared"] @ model.shared.covariance @ D["shared"].T
    return found, whole + sum((C for name, C in found.items() if name not in SHARED), np.zeros((6, 6)))


def test_each_source_and_all_together_are_as_the_true_placement_says(cell: Cell) -> None:
    case = Case.of(replace(cell, following_error=2e-4))
    sources, whole = _exact(case)
    error = placement_error(case.model, case.transfer)
    assert error.by_source().keys() == sources.keys()
    for name, (alone, _) in error.by_source().items():
        size = max(float(np.abs(sources[name]).max()), 1e-12)
        assert np.abs(alone - sources[name]).max() < 0.01 * size, name
    assert error.covariance == pytest.approx(whole, rel=0.01, abs=1e-10)


def test_the_parts_of_the_sources_add_up(cell: Cell) -> None:
    case = Case.of(cell)
    budget = placement_budget(case.model, case.transfer, FIT)
    assert sum(source.share for source in budget.sources.values()) == pytest.approx(1.0)
    assert [s.share for s in budget.sources.values()] == sorted(
        (s.share for s in budget.sources.values()), reverse=True
    )
    assert budget.sideways < np.sqrt(
        sum(s.sideways**2 for s in budget.sources.values())
    )  # camera and lens cancel
    assert (budget.source, budget.target) == ("01-02/2", "03-04/3")
    assert 0.2e-3 < budget.sideways < 0.6e-3
    assert budget.insertion > 0.997
