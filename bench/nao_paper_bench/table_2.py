"""The robot of the paper: its camera, its board, the errors of its Table 2, and the problem of finding them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pinocchio as pin

from arm.se3 import Array, frozen, transform
from calib.chain.fit import Problem, Sightings
from calib.nao.chain import LIMBS, NaoUnknowns
from nao_paper_bench.collision import BOARD_MIDDLE_X, BOARD_SIZE
from nao_paper_bench.kinematics import NaoKinematics
from vision.camera.model import Camera
from vision.targets.target import Target

NAO_CAMERA = Camera(
    np.array([[562.5, 0.0, 324.0], [0.0, 562.5, 189.0], [0.0, 0.0, 1.0]]), np.zeros(5), (640, 480), np.eye(4)
)
"""The lower camera as the paper calibrated it (section 3.2)."""
CHECKERBOARD = Target("checkerboard", 7, 5, 0.025, 0.0, "")
T_SOLE_TARGET = transform(
    [[0, 1, 0], [1, 0, 0], [0, 0, -1]], (BOARD_MIDDLE_X - BOARD_SIZE[0] / 2.0, -BOARD_SIZE[1] / 2.0, 0.0)
)
VERTICES = frozen(CHECKERBOARD.points() @ T_SOLE_TARGET[:3, :3].T + T_SOLE_TARGET[:3, 3])
"""(24, 3) m in the sole's frame."""
PAPER_PIXEL_SIGMA = frozen([0.0486, 0.0403])
"""Of the paper's simulation (section 3.1)."""
READING_SIGMA = float(np.radians(0.1) / np.sqrt(12.0))
"""Of encoders with steps of 0.1 deg, rad."""
TABLE_2 = frozen(
    [0.4660, -4.5338, -1.8354]
    + [-2.5029, 0.9392, 0.8049, -1.5869, 1.6285, -0.1476]
    + [-0.9565, 0.2258, 1.3778, -0.0065, 0.7371, -0.7784]
    + [-0.4419, -0.8538, 0.6988, 0.8289, -1.5198, 1.8391]
)
"""Mean of the paper's three runs, deg and mm: camera, left leg, right leg, left mount, right mount."""


def table_2_robot(
    unknowns: NaoUnknowns,
    rng: np.random.Generator,
    hard: bool = False,
    masses: pin.Model | None = None,
    half_backlash_deg: tuple[float, float] = (0.2, 0.6),
) -> NaoKinematics:
    """A NAO as Table 2 has it, and beyond it as `unknowns` say.

    The head is off by 0.5 and -0.4 deg, compliances are 0.3 to 0.9 deg/Nm, half a backlash is 0.2 to 0.6 deg, and each
    limb is 0.5 mm longer or shorter than the model's.
    """
    parts = [TABLE_2]
    if unknowns.head:
        parts.append(np.array([0.5, -0.4]))
    if unknowns.compliance:
        parts.append(rng.uniform(0.3, 0.9, 12))
    if unknowns.backlash:
        parts.append(rng.uniform(*half_backlash_deg, 12))
    if unknowns.limbs:
        parts.append(rng.choice((-0.5, 0.5), 2 * len(LIMBS)))
    return NaoKinematics(unknowns, frozen(np.concatenate(parts) * unknowns.si()), hard, True, masses)


def paper_problem(
    sightings: Sequence[Sightings], unknowns: NaoUnknowns, pixel_sigma: Array, reading_sigma: float
) -> Problem:
    """All of `unknowns` free, from zero; see `nao_paper_bench.run.NaoMeasurement.problem`."""
    count = len(unknowns.names)
    return Problem(
        sightings,
        NAO_CAMERA,
        np.zeros(count),
        np.full(count, np.inf),
        pixel_sigma,
        np.full(8, reading_sigma),
        np.ones(count, dtype=bool),
    )
