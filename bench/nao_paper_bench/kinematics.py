"""Kinematics of a NAO with errors: joint angles and sole poses at given readings, and commands that compensate.

This is the paper's compensation (section 2.2) in the sense of its eq. 2: the angle is the reading plus the offset, so
offsets are added to readings and subtracted from commands. Its text has the opposite signs, which hold for the offset
of the encoder relative to the joint.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import pinocchio as pin
from scipy.special import ndtr

from arm.se3 import Array
from calib.nao.backlash import torque_sigmas
from calib.nao.chain import (
    BACKLASH_NM,
    HEAD,
    LEG,
    MOUNT,
    SIDES,
    NaoUnknowns,
    gravity_torques,
    leg_chain,
    nao_chain,
    nao_model,
)

STANDING, ON_ITS_BACK = (0.0, 0.0, -9.81), (-9.81, 0.0, 0.0)
"""Gravity in the torso frame, m/s^2."""
_ROUNDS = 30


@dataclass(frozen=True, eq=False)
class NaoKinematics:
    """A NAO with joint offsets, and optionally compliance and backlash.

    Attributes:
        unknowns: its parameters.
        x: their values, SI.
        hard: whether backlash changes sides abruptly; otherwise smoothly over about `calib.nao.chain.BACKLASH_NM`.
        sure: whether torques are exact. If not, abrupt backlash is replaced by its mean over the uncertainty of the
            masses, which minimises the error.
        masses: model with other masses than ``urdf/nao``, or None.
    """

    unknowns: NaoUnknowns
    x: Array
    hard: bool = False
    sure: bool = False
    masses: pin.Model | None = None

    def angles(self, side: str, readings: Array, gravity: npt.ArrayLike) -> Array:
        """Angles (n, 6) rad of a leg at readings (n, 6), with gravity (3,) m/s^2 in the torso frame."""
        straight = readings + self._of(side, "deg")
        if not (self.unknowns.compliance or self.unknowns.backlash):
            return straight
        torque = gravity_torques(side, straight, gravity, self.masses)
        if not self.hard:
            lies = np.tanh(torque / BACKLASH_NM)
        elif self.sure:
            lies = np.sign(torque)
        else:
            lies = 2.0 * ndtr(torque / torque_sigmas(side, straight, gravity)) - 1.0
        bent = straight + self._of(side, "compliance_deg_per_Nm") * torque
        return np.asarray(bent + self._of(side, "backlash_half_deg") * lies)

    def heads(self, readings: Array) -> Array:
        """Angles (n, 2) rad of the head at readings (n, 2)."""
        return np.asarray(readings + [self._value(f"{j}_deg") for j in HEAD])

    def commands(self, side: str, wanted: Array, gravity: npt.ArrayLike) -> Array:
        """Readings (n, 6) rad that give a leg the angles `wanted`; approximate near a change of the backlash side."""
        readings = wanted - self._of(side, "deg")
        for _ in range(_ROUNDS):
            off = wanted - self.angles(side, readings, gravity)
            readings = readings + 0.5 * off  # damped, because the backlash side may alternate
        return np.asarray(readings)

    def T_camera_board(self, side: str, leg: Array, head: Array, gravity: npt.ArrayLike) -> Array:
        """Poses (n, 4, 4) of the board in the camera (OpenCV frame) at readings (n, 6) and (n, 2) rad."""
        return self._seen(side, leg, head, gravity, mounted=True)

    def T_camera_sole(self, side: str, leg: Array, head: Array, gravity: npt.ArrayLike) -> Array:
        """The same for the bare sole."""
        return self._seen(side, leg, head, gravity, mounted=False)

    def T_torso_sole(self, side: str, leg: Array, gravity: npt.ArrayLike) -> Array:
        """Poses (n, 4, 4) of the sole in the torso at readings (n, 6) rad."""
        return leg_chain(side, self.unknowns).evaluate(self.angles(side, leg, gravity), self.x).T

    def _seen(self, side: str, leg: Array, head: Array, gravity: npt.ArrayLike, mounted: bool) -> Array:
        plain = NaoUnknowns(limbs=self.unknowns.limbs)
        zero = tuple(side + name for side in SIDES for name in (LEG if mounted else (*LEG, *MOUNT)))
        rigid = [0.0 if name.startswith(zero) else self._value(name) for name in plain.names]
        angles = np.column_stack([self.angles(side, leg, gravity), self.heads(head)])
        return nao_chain(side, plain).evaluate(angles, np.array(rigid)).T

    def _of(self, side: str, kind: str) -> Array:
        return np.array([self._value(f"{side}{j}_{kind}") for j in LEG])

    def _value(self, name: str) -> float:
        return float(self.x[self.unknowns.names.index(name)]) if name in self.unknowns.names else 0.0


@dataclass(frozen=True)
class PoseErrors:
    """Differences of poses: rms and largest translation, m, and rms rotation, rad."""

    rms: float
    most: float
    rotation_rms: float


def pose_errors(T_true: Array, T_taken: Array) -> PoseErrors:
    """Errors of poses (n, 4, 4) relative to the true ones."""
    away = np.linalg.norm(T_true[:, :3, 3] - T_taken[:, :3, 3], axis=1)
    turned = np.einsum("nji,njk->nik", T_true[:, :3, :3], T_taken[:, :3, :3])
    angle = np.arccos(np.clip((np.trace(turned, axis1=1, axis2=2) - 1.0) / 2.0, -1.0, 1.0))
    return PoseErrors(float(np.sqrt(np.mean(away**2))), float(away.max()), float(np.sqrt(np.mean(angle**2))))


_STANDING_DEG = np.array([[-20, 5], [-15, 15], [-60, 10], [0, 90], [-60, 20], [-15, 15]], dtype=float)
_LOOKING_DEG = np.array([[-60, 60], [-30, 25]], dtype=float)


def standing_postures(count: int, rng: np.random.Generator) -> dict[str, tuple[Array, Array]]:
    """Readings of standing and swinging legs with any head posture: by side, (n, 6) and (n, 2) rad, `count` in all."""
    postures = {}
    for side, sign in zip(SIDES, (1.0, -1.0), strict=True):
        leg = np.radians(rng.uniform(_STANDING_DEG[:, 0], _STANDING_DEG[:, 1], (count // 2, 6)))
        leg[:, [1, 5]] *= sign
        looking = np.radians(rng.uniform(_LOOKING_DEG[:, 0], _LOOKING_DEG[:, 1], (count // 2, 2)))
        postures[side] = leg, looking
    return postures


def standing_error(true: NaoKinematics, taken: NaoKinematics, seed: int = 0, count: int = 600) -> PoseErrors:
    """Error of the soles' poses in the camera on standing and swinging postures."""
    T_true, T_taken = [], []
    for side, (leg, head) in standing_postures(count, np.random.default_rng(seed)).items():
        T_true.append(true.T_camera_sole(side, leg, head, STANDING))
        T_taken.append(taken.T_camera_sole(side, leg, head, STANDING))
    return pose_errors(np.concatenate(T_true), np.concatenate(T_taken))


def masses_off(part: float, rng: np.random.Generator) -> pin.Model:
    """The NAO with the mass of every link changed by the share `part`, up or down at random."""
    model = nao_model().copy()
    for i in range(1, model.njoints):
        factor = 1.0 + part * float(rng.choice((-1.0, 1.0)))
        model.inertias[i] = pin.Inertia(
            model.inertias[i].mass * factor, model.inertias[i].lever, model.inertias[i].inertia * factor
        )
    return model
