"""Optimal design of NAO measurements: choose the stances that together are most informative.

The information of a stance is known before it is taken: that of its images with the encoder errors eliminated
(generalised least squares, docs/sources.md, "Encoder errors"). The search is that of `calib.model.optimal_design`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from arm.errors import ImpossibleError
from arm.se3 import Array
from calib.model.least_squares import eliminate, inverse_scaled
from calib.nao.chain import LEG_JOINTS, SIDES, NaoUnknowns, nao_sightings
from nao_paper_bench.leg_design import LegDesign
from nao_paper_bench.stance_pool import (
    Stance,
    collision_free_motion,
    find_stances,
    near_stances,
    resting_posture,
)
from vision.camera.model import Camera
from vision.camera.projection import Projection, along

Criterion = Literal["A", "D"]
_NEAR, _TRIES = np.radians(12.0), 270  # spread of nearby stances; their number for all chosen ones
_WIDE = {"deg": np.radians(10.0), "mm": 0.01}  # wide prior that keeps determinants positive
_WIDE_SOFT = np.radians(1.0)  # prior on compliance, per Nm, and backlash


@dataclass(frozen=True, eq=False)
class Sensing:
    """Camera, board and noise of a measurement.

    Attributes:
        camera: intrinsics of the lower camera.
        board: vertices (m, 3) m in the sole frame.
        pixel_sigma: of a vertex in x and y, (2,) px.
        reading_sigma: of the encoders of leg and head, (8,) rad; 0 for exact ones.
        gravity: in the torso frame, (3,) m/s^2.
    """

    camera: Camera
    board: Array
    pixel_sigma: Array
    reading_sigma: Array
    gravity: tuple[float, float, float] = (-9.81, 0.0, 0.0)


@dataclass(frozen=True, eq=False)
class Plan:
    """Stances in an order in which the robot can reach them.

    Attributes:
        stances: of both legs.
        information: (unknowns, unknowns) of all of them, with a wide prior.
        unknowns: of the information.
    """

    stances: tuple[Stance, ...]
    information: Array
    unknowns: NaoUnknowns

    @property
    def joint_sigma_deg(self) -> float:
        """Expected rms standard deviation of the legs' joint offsets, deg."""
        places = [self.unknowns.names.index(f"{j}_deg") for j in LEG_JOINTS]
        return float(np.degrees(np.sqrt(np.diag(inverse_scaled(self.information))[places].mean())))


def find_pool(camera: Camera, count: int, seed: int) -> list[Stance]:
    """Candidate stances, `count` of each leg, see `nao_paper_bench.stance_pool.find_stances`."""
    rng = np.random.default_rng(seed)
    return [stance for side in SIDES for stance in find_stances(side, camera, count, rng)]


def plan_stances(
    pool: Sequence[Stance],
    count: int,
    sensing: Sensing,
    unknowns: NaoUnknowns,
    x: Array | None = None,
    criterion: Criterion | None = None,
    rounds: int = 4,
    seed: int = 0,
) -> Plan:
    """Choose the `count` most informative stances of each leg from a pool, then improve them locally.

    Args:
        pool: of both legs.
        count: of each leg.
        sensing: camera, board and noise.
        unknowns: to be estimated.
        x: rough values of the unknowns, SI; default: zero.
        criterion: A for the least summed variance of the legs' angles (offsets, backlash, and compliance under 1 Nm), D
            for the greatest determinant of all; default: A for rigid legs, D with compliance or backlash, where it
            gives smaller errors on a standing robot.
        rounds: of exchanges with stances near the chosen ones.
        seed: of these.

    Raises:
        ImpossibleError: the pool is too small.
    """
    criterion = criterion or ("D" if unknowns.compliance or unknowns.backlash else "A")
    rng, tries = np.random.default_rng(seed), -(-_TRIES // (2 * count))
    chosen = _exchanged(pool, [], count, sensing, unknowns, x, criterion)
    for number in range(rounds):
        spread = _NEAR / (1.0 + 0.5 * number)
        near = [n for s in chosen for n in near_stances(s, sensing.camera, tries, spread, rng)]
        chosen = _exchanged([*chosen, *near], range(len(chosen)), count, sensing, unknowns, x, criterion)
    return _plan(chosen, sensing, unknowns, x)


def random_stances(
    pool: Sequence[Stance],
    count: int,
    sensing: Sensing,
    unknowns: NaoUnknowns,
    rng: np.random.Generator,
    x: Array | None = None,
) -> Plan:
    """Choose `count` stances of each leg at random from a pool; 24 matches the paper.

    Raises:
        ImpossibleError: the pool is too small.
    """
    side = np.array([SIDES.index(s.side) for s in pool])
    _require(side, count)
    chosen = [int(i) for k in range(2) for i in rng.choice(np.flatnonzero(side == k), count, replace=False)]
    return _plan([pool[i] for i in chosen], sensing, unknowns, x)


def stance_informations(
    stances: Sequence[Stance], sensing: Sensing, unknowns: NaoUnknowns, x: Array | None = None
) -> Array:
    """Information of each stance, (n, unknowns, unknowns), with encoder errors eliminated."""
    x = np.zeros(len(unknowns.names)) if x is None else x
    found = np.empty((len(stances), len(x), len(x)))
    for side in SIDES:
        of = [i for i, s in enumerate(stances) if s.side == side]
        if of:
            found[of] = _informations(side, [stances[i] for i in of], sensing, unknowns, x)
    return found


def _informations(
    side: str, stances: Sequence[Stance], sensing: Sensing, unknowns: NaoUnknowns, x: Array
) -> Array:
    heads, m = len(stances[0].heads), len(sensing.board)
    which = np.repeat(np.arange(len(stances)), heads)
    leg = np.array([s.leg for s in stances])[which]
    head = np.concatenate([s.heads for s in stances])
    s = nao_sightings(
        side, unknowns, which, leg, head, sensing.board, np.zeros((len(which), m, 2)), sensing.gravity
    )
    at = s.evaluate(x, np.zeros_like(s.readings))
    by_target = Projection(sensing.camera, at.T, s.points).by_target / sensing.pixel_sigma[:, None]
    shape = (len(stances), heads * m * 2, -1)
    A, by_reading = along(by_target, at.by_unknown).reshape(shape), along(by_target, at.by_reading)
    by_reading = (by_reading * sensing.reading_sigma).reshape(len(stances), heads, m * 2, -1)
    N = np.zeros((len(stances), heads, m * 2, 6 + 2 * heads))
    N[..., :6] = by_reading[..., :6]
    for k in range(heads):
        N[:, k, :, 6 + 2 * k : 8 + 2 * k] = by_reading[:, k, :, 6:]
    return eliminate(A, N.reshape(shape), np.zeros(A.shape[:2]), np.eye(N.shape[-1])).S


def _prior(unknowns: NaoUnknowns) -> Array:
    return np.array(
        [
            _WIDE_SOFT if "compliance" in n or "backlash" in n else _WIDE[n.rpartition("_")[2]]
            for n in unknowns.names
        ]
    )


def _require(side: npt.NDArray[np.intp], count: int) -> None:
    least = min(int((side == k).sum()) for k in range(2))
    if least < count:
        raise ImpossibleError(
            f"{count} stances of each leg are needed, but the pool has {least}; make a larger pool",
            asked=count,
            pool=least,
        )


def _exchanged(
    pool: Sequence[Stance],
    begin: Sequence[int],
    count: int,
    sensing: Sensing,
    unknowns: NaoUnknowns,
    x: Array | None,
    criterion: Criterion,
) -> list[Stance]:
    """Choose `count` stances of each leg: complete `begin` greedily, then exchange one by one."""
    side = np.array([SIDES.index(s.side) for s in pool])
    _require(side, count)
    informations, prior = stance_informations(pool, sensing, unknowns, x), np.diag(_prior(unknowns) ** -2)
    kinds = tuple(f"{j}_{kind}" for j in LEG_JOINTS for kind in ("deg", "compliance", "backlash"))
    legs = [i for i, name in enumerate(unknowns.names) if name.startswith(kinds)]
    worth = np.eye(len(prior))[:, legs] if criterion == "A" else None
    best = LegDesign(informations, prior, worth, side).best(count * len(SIDES), begin=begin)
    return [pool[i] for i in best.places]


def _plan(stances: Sequence[Stance], sensing: Sensing, unknowns: NaoUnknowns, x: Array | None) -> Plan:
    total = stance_informations(stances, sensing, unknowns, x).sum(axis=0) + np.diag(_prior(unknowns) ** -2)
    return Plan(_in_order(stances), total, unknowns)


def _in_order(stances: Sequence[Stance]) -> tuple[Stance, ...]:
    """Order stances leg by leg, each followed by the nearest one with a collision-free direct motion, if any."""
    now = resting_posture()
    ordered: list[Stance] = []
    left = list(stances)
    while left:
        side = [s for s in left if not ordered or s.side == ordered[-1].side] or left
        postures = [s.posture(s.heads[0]) for s in side]
        by_distance = np.argsort([np.abs(p - now).max() for p in postures])
        direct = (i for i in by_distance if collision_free_motion(now, postures[i]))
        next_one = side[next(direct, by_distance[0])]
        left = [s for s in left if s is not next_one]
        ordered.append(next_one)
        now = next_one.posture(next_one.heads[-1])
    return tuple(ordered)
