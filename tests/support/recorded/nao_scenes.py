"""Images of a NAO's checkerboards for its calibration: vertices with stated noise, readings rounded to their step."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pinocchio as pin
from nao_paper_bench.kinematics import ON_ITS_BACK as ON_ITS_BACK
from nao_paper_bench.stance_design import Sensing
from nao_paper_bench.table_2 import NAO_CAMERA, PAPER_PIXEL_SIGMA, VERTICES, paper_problem, table_2_robot
from nao_paper_bench.table_2 import TABLE_2 as TABLE_2

from arm.se3 import Array
from calib.chain.fit import Problem, Sightings
from calib.nao.chain import LEG, SIDES, NaoUnknowns, nao_model, nao_sightings

CAMERA, BOARD, PIXEL_SIGMA = NAO_CAMERA, VERTICES, PAPER_PIXEL_SIGMA
STEP = np.radians(0.1)
PAPER, ALL = NaoUnknowns(), NaoUnknowns(True, True, True)
SENSING = Sensing(CAMERA, BOARD, PIXEL_SIGMA, np.full(8, STEP / np.sqrt(12.0)))
LEG_DEG = np.array([[-45, 5], [-15, 15], [-85, -30], [0, 60], [-40, 30], [-10, 10]], dtype=float)
HEAD_DEG = np.array([[-60, 60], [-25, 15]], dtype=float)


def truth(unknowns: NaoUnknowns, rng: np.random.Generator) -> Array:
    """Errors of the robot of Table 2, SI."""
    return table_2_robot(unknowns, rng).x


def sightings(
    seed: int, true: NaoUnknowns, fitted: NaoUnknowns, stances: int = 24, step: float = STEP
) -> tuple[list[Sightings], Array]:
    """Random stances of both legs with three postures of the head each, boards wholly in view; and the truth.

    Args:
        true: what the robot has.
        fitted: what is looked for.
        step: of the encoders, rad; 0 for exact ones.
    """
    rng = np.random.default_rng(seed)
    x = truth(true, rng)
    found = []
    for side in SIDES:
        legs, heads = _postures(side, true, x, rng, stances)
        read_legs, read_heads = (np.rint(q / step) * step if step else q for q in (legs, heads))
        which = np.repeat(np.arange(stances), 3)
        exact = nao_sightings(
            side, true, which, legs, heads, BOARD, np.zeros((len(which), 24, 2)), ON_ITS_BACK
        )
        pixels = exact.projection(CAMERA, x).pixels + PIXEL_SIGMA * rng.standard_normal((len(which), 24, 2))
        found.append(nao_sightings(side, fitted, which, read_legs, read_heads, BOARD, pixels, ON_ITS_BACK))
    return found, x


def _postures(
    side: str, true: NaoUnknowns, x: Array, rng: np.random.Generator, stances: int
) -> tuple[Array, Array]:
    """Legs (3 stances, 6) and heads (3 stances, 2) rad; three images a stance."""
    legs: list[Array] = []
    heads: list[Array] = []
    mirror = np.array([1.0, 1.0 if side == "L" else -1.0, 1.0, 1.0, 1.0, 1.0])
    while len(legs) < 3 * stances:
        leg = np.radians(rng.uniform(LEG_DEG[:, 0], LEG_DEG[:, 1], (40, 6))) * mirror
        many = np.repeat(leg, 40, axis=0)
        head = np.radians(rng.uniform(HEAD_DEG[:, 0], HEAD_DEG[:, 1], (len(many), 2)))
        number = np.repeat(np.arange(40), 40)
        tried = nao_sightings(
            side, true, number, many, head, BOARD, np.zeros((len(many), 24, 2)), ON_ITS_BACK
        )
        with np.errstate(invalid="ignore"):
            pixels = tried.projection(CAMERA, x).pixels
            inside = ((pixels > 5.0) & (pixels < np.array(CAMERA.size) - 6.0)).all(axis=(1, 2))
        for k in range(40):
            good = np.flatnonzero(inside & (number == k))[:3]
            if len(good) == 3 and len(legs) < 3 * stances:
                legs += list(many[good])
                heads += list(head[good])
    return np.array(legs), np.array(heads)


def problem(found: list[Sightings], unknowns: NaoUnknowns, step: float = STEP) -> Problem:
    """All that is unknown, from zero."""
    return paper_problem(found, unknowns, PIXEL_SIGMA, step / np.sqrt(12.0))


def bent_legs(
    side: str,
    legs: Array,
    x: Array,
    gravity: tuple[float, float, float],
    hard: bool,
    model: pin.Model | None = None,
) -> Array:
    """Angles of a leg with compliance and backlash, by finite differences of the potential energy."""
    model = (model or nao_model()).copy()
    model.gravity.linear = np.array(gravity)
    data = model.createData()
    first = model.joints[model.getJointId(f"{side}HipYawPitch")].idx_q

    def energy(leg: Array) -> float:
        q = np.zeros(model.nq)
        q[first : first + 6] = leg
        return float(pin.computePotentialEnergy(model, data, q))

    def of(kind: str) -> Array:
        return x[[ALL.names.index(f"{side}{joint}_{kind}") for joint in LEG]]

    found = []
    for leg in legs + of("deg"):
        steps = 1e-6 * np.eye(6)
        torque = np.array([-(energy(leg + s) - energy(leg - s)) / 2e-6 for s in steps])
        lies = np.sign(torque) if hard else np.tanh(torque / 0.05)
        found.append(leg + of("compliance_deg_per_Nm") * torque + of("backlash_half_deg") * lies)
    return np.array(found)


def frames(q: Array) -> Callable[[str], pin.SE3]:
    """Where each joint of the model is at a posture."""
    model = nao_model()
    data = model.createData()
    pin.framesForwardKinematics(model, data, q)
    return lambda name: data.oMf[model.getFrameId(name)]


def of_board(across: float) -> Array:
    """Points (n, 3) m of the board's plane in the sole's frame, `across` times as large as the board."""
    x, y = np.meshgrid(np.linspace(-1, 1, 9), np.linspace(-1, 1, 13))
    return np.stack([0.17 + across * 0.0625 * x, across * 0.0875 * y, 0.0 * x], axis=-1).reshape(-1, 3)
