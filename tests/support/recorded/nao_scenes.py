"""Images of a NAO's checkerboards for its calibration: vertices with stated noise, readings rounded to their step."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pinocchio as pin

from arm.se3 import Array, frozen
from calib.chain.fit import Problem, Sightings
from calib.nao.chain import SIDES, NaoUnknowns, nao_model, nao_sightings
from calib.nao.stance_design import Sensing
from vision.camera.model import Camera

CAMERA = Camera(np.array([[562.5, 0, 324], [0, 562.5, 189], [0, 0, 1]]), np.zeros(5), (640, 480), np.eye(4))
PIXEL_SIGMA = np.array([0.0486, 0.0403])
ON_ITS_BACK = (-9.81, 0.0, 0.0)
STEP = np.radians(0.1)
BOARD = frozen([(0.1325 + 0.025 * i, 0.025 * j - 0.0625, 0.0) for i in range(4) for j in range(6)])
PAPER, ALL = NaoUnknowns(), NaoUnknowns(True, True, True)
SENSING = Sensing(CAMERA, BOARD, PIXEL_SIGMA, np.full(8, STEP / np.sqrt(12.0)))
# Table 2, mean of three runs: camera, left leg, right leg, left mount, right mount
TABLE_2 = np.array(
    [0.4660, -4.5338, -1.8354]
    + [-2.5029, 0.9392, 0.8049, -1.5869, 1.6285, -0.1476]
    + [-0.9565, 0.2258, 1.3778, -0.0065, 0.7371, -0.7784]
    + [-0.4419, -0.8538, 0.6988, 0.8289, -1.5198, 1.8391]
)
LEG_DEG = np.array([[-45, 5], [-15, 15], [-85, -30], [0, 60], [-40, 30], [-10, 10]], dtype=float)
HEAD_DEG = np.array([[-60, 60], [-25, 15]], dtype=float)


def truth(unknowns: NaoUnknowns, rng: np.random.Generator) -> Array:
    """Table 2, a head 0.5 and -0.4 deg off, springs of 0.3 to 0.9 deg/Nm and half a play of 0.2 to 0.6 deg."""
    parts = [TABLE_2]
    if unknowns.head:
        parts.append(np.array([0.5, -0.4]))
    if unknowns.springs:
        parts.append(rng.uniform(0.3, 0.9, 12))
    if unknowns.play:
        parts.append(rng.uniform(0.2, 0.6, 12))
    return np.concatenate(parts) * unknowns.si()


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
        pixels = _seen(exact, x) + PIXEL_SIGMA * rng.standard_normal((len(which), 24, 2))
        found.append(nao_sightings(side, fitted, which, read_legs, read_heads, BOARD, pixels, ON_ITS_BACK))
    return found, x


def _seen(s: Sightings, x: Array) -> Array:
    T = s.evaluate(x, np.zeros_like(s.readings)).T
    return CAMERA.project(np.einsum("nij,mj->nmi", T[:, :3, :3], s.points) + T[:, None, :3, 3])


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
            pixels = _seen(tried, x)
            inside = ((pixels > 5.0) & (pixels < np.array(CAMERA.size) - 6.0)).all(axis=(1, 2))
        for k in range(40):
            good = np.flatnonzero(inside & (number == k))[:3]
            if len(good) == 3 and len(legs) < 3 * stances:
                legs += list(many[good])
                heads += list(head[good])
    return np.array(legs), np.array(heads)


def problem(found: list[Sightings], unknowns: NaoUnknowns, step: float = STEP) -> Problem:
    """All that is unknown, from zero."""
    count = len(unknowns.names)
    sigma = np.full(8, step / np.sqrt(12.0))
    return Problem(
        found, CAMERA, np.zeros(count), np.full(count, np.inf), PIXEL_SIGMA, sigma, np.ones(count, dtype=bool)
    )


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
