"""Candidate stances of a NAO: postures of legs and head in which the camera sees a board on the robot's own sole.

Limits are those of ``urdf/nao/nao.urdf``. Aldebaran publishes them, but those of the legs could not be cited and count
as assumed; the coupling of its ankle limits and of its head limits is ignored. One motor drives both HipYawPitch joints
of a NAO, so the leg that is not measured moves with the other.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from arm.errors import ImpossibleError, InputError
from arm.se3 import Array, frozen
from calib.model.chain import Chain
from calib.model.from_urdf import chain_from_root
from calib.nao.chain import HEAD, LEG, SIDES, nao_model
from nao_paper_bench.collision import BOARD_MIDDLE_X, BOARD_SIZE, nao_bodies
from vision.camera.model import Camera

LIMIT_MARGIN = np.radians(2.0)
MARGIN_PX = 45.0  # an uncalibrated camera may be off by 5 deg
HEADS = 3
_HEAD_YAWS, _HEAD_PITCHES = np.radians(np.arange(-60.0, 61.0, 10.0)), np.radians(np.arange(-36.0, 29.0, 8.0))
_MOST_SLANT = np.radians(60.0)
_MOTION_STEP = np.radians(3.0)
_MOST_LEGS, _MOST_AT_ONCE = 20_000, 4000  # about one in a hundred is feasible
_BEFORE = 5e-3  # m above a board: where lines of sight end
_PARKED_DEG = [(roll, pitch) for pitch in (0.0, -15.0, -30.0, -50.0) for roll in (15.0, 30.0, 42.0, 5.0)]


@dataclass(frozen=True, eq=False)
class Stance:
    """One leg held before the camera, the other parked.

    Attributes:
        side: L or R, of the leg in view.
        leg: its angles (6,) rad.
        other: those of the other leg, (6,).
        heads: head postures with the whole board in view, (3, 2).
    """

    side: str
    leg: Array
    other: Array
    heads: Array

    def posture(self, head: Array) -> Array:
        """Angles of all joints of the model."""
        left, right = (self.leg, self.other) if self.side == "L" else (self.other, self.leg)
        return nao_bodies().posture(left, right, head)


def joint_limits(joints: Sequence[str]) -> Array:
    """Lower and upper limits (2, n) rad."""
    model = nao_model()
    at = [model.joints[model.getJointId(j)].idx_q for j in joints]
    return np.array([model.lowerPositionLimit[at], model.upperPositionLimit[at]])


def find_stances(
    side: str, camera: Camera, count: int, rng: np.random.Generator, margin_px: float = MARGIN_PX
) -> list[Stance]:
    """Sample stances of one leg within limits, reachable from rest, and with the board in view in three head postures.

    Args:
        side: L or R.
        camera: intrinsics of the lower camera.
        count: number of stances.
        rng: random generator.
        margin_px: distance of the board from the image border.

    Raises:
        InputError: no such side.
        ImpossibleError: too few are found, as with too large a margin.
    """
    if side not in SIDES:
        raise InputError(f"side = {side!r}: must be L or R", side=side)
    low, high = joint_limits([side + j for j in LEG]) + np.array([[LIMIT_MARGIN], [-LIMIT_MARGIN]])
    found: list[Stance] = []
    tried, batch = 0, min(20 * count + 1000, _MOST_AT_ONCE)
    while len(found) < count:
        if tried >= _MOST_LEGS * (1 + len(found)):
            raise ImpossibleError(
                f"only {len(found)} of {count} stances of leg {side} show the whole board {margin_px:g} px inside the "
                f"image, of {tried} tried; reduce the margin",
                side=side,
                found=len(found),
                tried=tried,
            )
        legs = rng.uniform(low, high, (batch, 6))
        tried += batch
        found += _feasible(side, legs, camera, margin_px, None)
    return found[:count]


def near_stances(
    stance: Stance,
    camera: Camera,
    tries: int,
    spread: float,
    rng: np.random.Generator,
    margin_px: float = MARGIN_PX,
) -> list[Stance]:
    """Sample feasible stances near one, with random head postures; fewer than `tries`, perhaps none.

    Args:
        stance: to vary.
        camera: intrinsics of the lower camera.
        tries: number of samples.
        spread: standard deviation of the changes of the joints, rad.
        rng: random generator.
        margin_px: as in `find_stances`.
    """
    low, high = joint_limits([stance.side + j for j in LEG]) + np.array([[LIMIT_MARGIN], [-LIMIT_MARGIN]])
    legs = np.clip(stance.leg + spread * rng.standard_normal((tries, 6)), low, high)
    return _feasible(stance.side, legs, camera, margin_px, rng)


def _feasible(
    side: str, legs: Array, camera: Camera, margin_px: float, rng: np.random.Generator | None
) -> list[Stance]:
    """Feasible stances among legs (n, 6); head postures far apart, or random given `rng`."""
    heads, T_camera_torso = _heads()
    T = _sole_chain(side).evaluate(legs, np.zeros(0)).T
    near = np.flatnonzero(_may_be_seen(T))
    visible = _visible(camera, T[near], T_camera_torso, margin_px)
    found = []
    for leg, T_sole, sees in zip(legs[near], T[near], visible, strict=True):
        if np.count_nonzero(sees) < HEADS:
            continue
        chosen = (
            _far_apart(heads[sees]) if rng is None else rng.choice(heads[sees], HEADS, replace=False, axis=0)
        )
        stance = _stance(side, leg, chosen, T_sole)
        if stance is not None:
            found.append(stance)
    return found


@lru_cache(maxsize=2)
def _sole_chain(side: str) -> Chain:
    return chain_from_root(nao_model(), f"{side}_sole", {side + j: i for i, j in enumerate(LEG)})


@lru_cache(maxsize=1)
def _heads() -> tuple[Array, Array]:
    """Head postures (h, 2) rad within limits, and T_camera_torso (h, 4, 4), x forward."""
    low, high = joint_limits(HEAD)
    grid = np.array([(yaw, pitch) for yaw in _HEAD_YAWS for pitch in _HEAD_PITCHES])
    grid = grid[((grid > low) & (grid < high)).all(axis=1)]
    chain = chain_from_root(nao_model(), "lower_camera", {j: i for i, j in enumerate(HEAD)})
    return frozen(grid), frozen(np.linalg.inv(chain.evaluate(grid, np.zeros(0)).T))


def _outline() -> Array:
    """Corners of the board and midpoints of its edges, (9, 3) m in the sole frame, its centre last."""
    x = BOARD_MIDDLE_X + BOARD_SIZE[0] / 2.0 * np.array([-1, -1, -1, 0, 1, 1, 1, 0, 0])
    y = BOARD_SIZE[1] / 2.0 * np.array([-1, 0, 1, 1, 1, 0, -1, -1, 0])
    return np.stack([x, y, np.zeros(9)], axis=-1)


def _may_be_seen(T: Array) -> npt.NDArray[np.bool_]:
    """Whether boards at T_torso_sole (n, 4, 4) lie in front of the torso with their upper side towards the head."""
    middle = np.einsum("nij,j->ni", T[:, :3, :3], [BOARD_MIDDLE_X, 0.0, 0.0]) + T[:, :3, 3]
    to_head = np.array([0.05, 0.0, 0.14]) - middle
    cosine = np.einsum("ni,ni->n", T[:, :3, 2], to_head) / np.linalg.norm(to_head, axis=1)
    return np.asarray((middle[:, 0] > 0.08) & (cosine > np.cos(_MOST_SLANT)))


def _visible(camera: Camera, T: Array, T_camera_torso: Array, margin: float) -> npt.NDArray[np.bool_]:
    """(n, h): whether the whole outline is in the image, for soles T (n, 4, 4) and heads (h, 4, 4)."""
    points = np.einsum("nij,mj->nmi", T[:, :3, :3], _outline()) + T[:, None, :3, 3]
    seen = np.empty((len(T), len(T_camera_torso)), dtype=bool)
    last = np.array(camera.size) - 1.0 - margin
    for h, C in enumerate(T_camera_torso):
        forward = points @ C[:3, :3].T + C[:3, 3]
        optical = np.stack([-forward[..., 1], -forward[..., 2], forward[..., 0]], axis=-1)
        with np.errstate(invalid="ignore"):
            pixels = camera.project(optical)
            seen[:, h] = ((pixels >= margin) & (pixels <= last)).all(axis=(1, 2))
    return seen


def _stance(side: str, leg: Array, chosen: Array, T_sole: Array) -> Stance | None:
    """The stance with the other leg parked without contact and with free lines of sight for all heads, or None."""
    bodies = nao_bodies()
    points = _outline()[[0, 2, 4, 6]] @ T_sole[:3, :3].T + T_sole[:3, 3] + _BEFORE * T_sole[:3, 2]
    outwards = -1.0 if side == "L" else 1.0  # of the other leg
    for roll, pitch in _PARKED_DEG:
        other = np.array([leg[0], outwards * np.radians(roll), np.radians(pitch), 0.0, 0.0, 0.0])
        stance = Stance(side, frozen(leg), frozen(other), frozen(chosen))
        if any(bodies.touching(stance.posture(head)) for head in chosen):
            continue
        if not collision_free_motion(resting_posture(), stance.posture(chosen[0])):
            continue
        hidden = any(bodies.hidden(stance.posture(head), points) for head in chosen)
        return None if hidden else stance
    return None


def resting_posture() -> Array:
    """Legs stretched and slightly apart, head straight: where a measurement starts and ends."""
    left = np.radians([0.0, 20.0, -15.0, 0.0, 0.0, 0.0])
    return nao_bodies().posture(left, left * [1.0, -1.0, 1.0, 1.0, 1.0, 1.0], np.zeros(2))


def collision_free_motion(a: Array, b: Array) -> bool:
    """Whether the straight motion in joint space from one posture to another is collision-free."""
    bodies = nao_bodies()
    steps = int(np.ceil(np.abs(b - a).max() / _MOTION_STEP)) + 1
    return not any(bodies.touching(a + t * (b - a)) for t in np.linspace(0.0, 1.0, steps))


def _far_apart(heads: Array) -> Array:
    """Three head postures far from each other, starting with the one farthest from the mean."""
    chosen = [int(np.argmax(np.linalg.norm(heads - heads.mean(axis=0), axis=1)))]
    while len(chosen) < HEADS:
        apart = np.linalg.norm(heads[:, None] - heads[chosen][None], axis=-1).min(axis=1)
        chosen.append(int(np.argmax(apart)))
    return heads[chosen]
