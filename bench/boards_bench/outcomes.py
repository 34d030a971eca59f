"""What came of a scene: how far the pose is off, what the bound is, what it said of itself, and whether it was used."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from arm.board import Board
from arm.se3 import Array
from boards_bench.scenes import Conditions, Frames, Scene, bound, drawn, hole_levers
from boards_bench.spoils import SPOILS
from boards_bench.ways import WAYS
from pictures.boards import lab_camera, twist_between
from vision.boards.checks import Spread
from vision.boards.pose import assess_board

WRONG_TURN_DEG, WRONG_SIDEWAYS_MM, WRONG_HEIGHT_MM = 2.0, 2.0, 5.0


@dataclass(frozen=True)
class Outcome:
    """Of one scene; m and rad. NaN where there is no pose.

    Attributes:
        hole, depth, turn: mean square of the holes' error, of its part along the camera's ray, and of the turn.
        hole_bound, turn_bound: Cramer-Rao bounds of the same.
        hole_predicted, depth_predicted, turn_predicted: by the pose's covariance.
        sideways, height: of the hole that is farthest off, in the plate and across it.
        nees: squared error of the twist in its own covariance, per degree of freedom.
        spread, turn_std_bound: standard deviations that the pose states, and the bound's of the turn (worst axis).
        accepted: whether the pose may be used.
        fits_set: whether the tilt is one of the set that was given; None without one.
        told: all doubts.
    """

    hole: float
    depth: float
    turn: float
    hole_bound: float
    turn_bound: float
    hole_predicted: float
    depth_predicted: float
    turn_predicted: float
    sideways: float
    height: float
    nees: float
    spread: Spread
    turn_std_bound: float
    accepted: bool
    fits_set: bool | None
    told: tuple[str, ...]

    @property
    def turned_wrong(self) -> bool:
        """More than 2 deg off."""
        return not self.turn <= np.radians(WRONG_TURN_DEG) ** 2

    @property
    def wrong(self) -> bool:
        """Off by more than a grasp can bear."""
        return (
            self.turned_wrong
            or not self.sideways <= WRONG_SIDEWAYS_MM / 1e3
            or not self.height <= WRONG_HEIGHT_MM / 1e3
        )

    def flagged(self, turn_limit: float) -> bool:
        """Whether it would be refused with another limit of the turn's standard deviation, rad."""
        others = [t for t in self.told if "its turn to" not in t or "a hole" in t]
        return bool(others) or not self.spread.turn <= turn_limit


def outcomes(
    seeds: range, of: Conditions, spoil: str = "", tilts: tuple[float, ...] = (), way: str = ""
) -> list[Outcome]:
    """Assess scenes; `spoil` is what is wrong with them, `way` another estimator than ours."""
    return [_outcome(seed, of, spoil, tilts, way) for seed in seeds]


def _outcome(seed: int, of: Conditions, spoil: str, tilts: tuple[float, ...], way: str) -> Outcome:
    camera, scene = lab_camera(), drawn(seed, of)
    board, frames = SPOILS[spoil](scene, np.random.default_rng([seed, 7]))
    C = bound(scene, of, camera)
    if way:
        T = camera.T_base_camera @ WAYS[way](board, frames, camera)
        return _compared(scene, T, C, np.full((6, 6), np.nan))
    return assessed(scene, C, board, frames, tilts)


def assessed(scene: Scene, C: Array, board: Board, frames: Frames, tilts: tuple[float, ...] = ()) -> Outcome:
    """Our estimate of a scene from what was seen, its file saying `board`, against its bound C."""
    seen = assess_board(board, frames, lab_camera(), tilts=tilts)
    told = tuple(str(doubt) for doubt in seen.doubts)
    if seen.pose is None:
        return _compared(scene, np.full((4, 4), np.nan), C, np.full((6, 6), np.nan), told=told)
    fits = seen.pose.tilt_hypothesis.fits if seen.pose.tilt_hypothesis else None
    spread = Spread.of(seen.pose)
    return _compared(
        scene, seen.pose.T_base_board, C, seen.pose.covariance, spread, seen.accepted, fits, told
    )


def _compared(
    scene: Scene,
    T: Array,
    C: Array,
    P: Array,
    spread: Spread | None = None,
    accepted: bool = False,
    fits: bool | None = None,
    told: tuple[str, ...] = (),
) -> Outcome:
    ray = (lab_camera().T_camera_base @ scene.T_base_board)[2, :3]
    xi = twist_between(T, scene.T_base_board) if np.isfinite(T).all() else np.full(6, np.nan)
    E, levers = np.outer(xi, xi), hole_levers(scene.board)

    def holes(M: Array) -> float:
        return float(np.mean([np.trace(L @ M @ L.T) for L in levers]))

    def depth(M: Array) -> float:
        return float(np.mean([ray @ L @ M @ L.T @ ray for L in levers]))

    off = np.array([L @ xi for L in levers])
    return Outcome(
        hole=holes(E),
        depth=depth(E),
        turn=float(np.trace(E[3:, 3:])),
        hole_bound=holes(C),
        turn_bound=float(np.trace(C[3:, 3:])),
        hole_predicted=holes(P),
        depth_predicted=depth(P),
        turn_predicted=float(np.trace(P[3:, 3:])),
        sideways=float(np.linalg.norm(off[:, :2], axis=1).max()),
        height=float(np.abs(off[:, 2]).max()),
        nees=float(xi @ np.linalg.solve(P, xi)) / 6.0 if np.isfinite(P).all() else np.nan,
        spread=spread or Spread(np.nan, np.nan, np.nan),
        turn_std_bound=float(np.sqrt(np.linalg.eigvalsh(C[3:, 3:])[-1])),
        accepted=accepted,
        fits_set=fits,
        told=told,
    )


def column(found: Sequence[Outcome], name: str) -> Array:
    """One attribute of all."""
    return np.array([getattr(o, name) for o in found], dtype=float)


def ratio(found: Sequence[Outcome], above: str, below: str) -> float:
    """Root of the pooled ratio of two mean squares."""
    return float(np.sqrt(column(found, above).mean() / column(found, below).mean()))
