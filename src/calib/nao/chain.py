"""Kinematic chains of the NAO: from the lower camera to the checkerboards on the soles.

T. Kastner, T. Roefer, T. Laue, "Automatic robot calibration for the NAO" (2014): eqs. 1 to 5 for the chain, Table 1 for
the unknowns. In addition (its future work): offsets of the head joints, compliance and backlash of the leg joints, and
errors of the limbs' lengths. What is assumed is listed in docs/sources.md, "The NAO and its paper".
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from arm.former import former_names, renamed_arguments
from arm.io.storage import data_file
from arm.se3 import Array, Indices, frozen, transform
from calib.chain.fit import Gains, Sightings
from calib.model.chain import Chain, Element, Fixed, Motion, Unknown, joined
from calib.model.from_urdf import chain_from_root

LEG = ("HipYawPitch", "HipRoll", "HipPitch", "KneePitch", "AnklePitch", "AnkleRoll")
HEAD = ("HeadYaw", "HeadPitch")
SIDES = ("L", "R")
LEG_JOINTS = tuple(side + joint for side in SIDES for joint in LEG)
CAMERA_TURNS = ("CamYaw", "CamPitch", "CamRoll")
MOUNT = ("RotZ", "TransX", "TransY")
LIMBS = ("HipWidth", "HipHeight", "Thigh", "Tibia", "Foot")
BACKLASH_NM = 0.05  # torque scale over which smooth backlash changes sides (assumed)
_SAME_STANCE = np.radians(3.0)  # a fit may move readings by a degree meanwhile
_X, _Y, _Z = np.eye(3)
# the paper's camera looks along x
_FORWARD = transform([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])


@renamed_arguments(springs="compliance", play="backlash")
@dataclass(frozen=True)
class NaoUnknowns:
    """The estimated parameters beyond the paper's 21.

    Attributes:
        head: offsets of both head joints.
        compliance: of every leg joint.
        backlash: half that of every leg joint.
        limbs: how much longer than the model's each limb is: from the torso out and down to the hip, thigh, tibia, and
            from the ankle down to the board.
    """

    head: bool = False
    compliance: bool = False
    backlash: bool = False
    limbs: bool = False

    @property
    def names(self) -> list[str]:
        """Names in order, each with its unit, as in the data's ground truth."""
        return [
            *(f"{n}_deg" for n in (*CAMERA_TURNS, *LEG_JOINTS)),
            *(f"{s}{m}_{'deg' if m == 'RotZ' else 'mm'}" for s in SIDES for m in MOUNT),
            *(f"{n}_deg" for n in HEAD if self.head),
            *(f"{n}_compliance_deg_per_Nm" for n in LEG_JOINTS if self.compliance),
            *(f"{n}_backlash_half_deg" for n in LEG_JOINTS if self.backlash),
            *(f"{s}{n}_mm" for s in SIDES for n in LIMBS if self.limbs),
        ]

    def si(self) -> Array:
        """Size of each name's unit in rad, m or rad/Nm."""
        return np.array([1e-3 if n.endswith("_mm") else np.pi / 180.0 for n in self.names])


@lru_cache(maxsize=1)
def nao_model() -> pin.Model:
    """The NAO of ``urdf/nao/nao.urdf``, with a fixed torso."""
    return pin.buildModelFromUrdf(str(data_file("urdf/nao/nao.urdf")))


@lru_cache(maxsize=32)
def nao_chain(side: str, unknowns: NaoUnknowns) -> Chain:
    """T_camera_board, from the camera frame (OpenCV) to the sole frame with the board's mount."""
    names = unknowns.names

    def of(name: str, gain: str = "") -> Unknown:
        return Unknown(names.index(name), gain)

    def of_joint(joint: str) -> tuple[Unknown, ...]:
        gain_of = {
            f"{joint}_deg": "",
            f"{joint}_compliance_deg_per_Nm": f"torque {joint}",
            f"{joint}_backlash_half_deg": f"backlash {joint}",
        }
        return tuple(of(name, gain) for name, gain in gain_of.items() if name in names)

    columns = {joint: len(LEG) + i for i, joint in enumerate(HEAD)}
    head = chain_from_root(nao_model(), "lower_camera", columns, of_joint)
    turns = [
        Motion(frozen(axis), unknowns=(of(f"{name}_deg"),))
        for axis, name in ((_Y, "CamPitch"), (_X, "CamRoll"), (_Z, "CamYaw"))  # eq. 3
    ]
    camera = Chain((*head.elements, *turns, Fixed(_FORWARD)))
    leg = leg_chain(side, unknowns, of_joint)
    mount = [
        Motion(frozen(_Z), unknowns=(of(f"{side}RotZ_deg"),)),  # eq. 4
        Motion(frozen(_X), turns=False, unknowns=(of(f"{side}TransX_mm"),)),
        Motion(frozen(_Y), turns=False, unknowns=(of(f"{side}TransY_mm"),)),
    ]
    return joined([*camera.inverse().elements, *leg.elements, *mount])


def leg_chain(
    side: str, unknowns: NaoUnknowns, unknowns_of: Callable[[str], tuple[Unknown, ...]] = lambda joint: ()
) -> Chain:
    """T_torso_sole with the errors of the limbs, if they are unknowns.

    Args:
        side: L or R.
        unknowns: to be estimated.
        unknowns_of: a joint's own, from its name.
    """
    longer = _limbs(side, unknowns.names)
    columns = {side + joint: i for i, joint in enumerate(LEG)}
    leg = chain_from_root(
        nao_model(), f"{side}_sole", columns, unknowns_of, lambda joint: longer.get(joint[1:], ())
    )
    return Chain((*longer.get("", ()), *leg.elements))


def _limbs(side: str, names: Sequence[str]) -> dict[str, tuple[Element, ...]]:
    """Translations of a leg's limb errors after each joint, by its name without the side; "" for before the first."""
    out = _Y if side == "L" else -_Y
    along = {"HipWidth": ("", out), "HipHeight": ("", -_Z)}
    along |= {"Thigh": ("HipPitch", -_Z), "Tibia": ("KneePitch", -_Z), "Foot": ("AnkleRoll", -_Z)}
    found: dict[str, tuple[Element, ...]] = {}
    for limb, (joint, axis) in along.items():
        if (name := f"{side}{limb}_mm") in names:
            motion = Motion(frozen(axis), turns=False, unknowns=(Unknown(names.index(name)),))
            found[joint] = (*found.get(joint, ()), motion)
    return found


def gravity_torques(side: str, legs: Array, gravity: npt.ArrayLike, model: pin.Model | None = None) -> Array:
    """Torques of gravity on a leg's joints, Nm, (n, 6).

    Args:
        side: L or R.
        legs: angles (n, 6) rad.
        gravity: in the torso frame, (3,) m/s^2.
        model: with other masses, or None.
    """
    model = (nao_model() if model is None else model).copy()
    model.gravity.linear = np.asarray(gravity, dtype=float)
    data = model.createData()
    columns = [model.joints[model.getJointId(side + joint)].idx_q for joint in LEG]
    torque = np.empty((len(legs), len(LEG)))
    q = np.zeros(model.nq)
    for n, leg in enumerate(legs):
        q[columns] = leg
        torque[n] = -pin.computeGeneralizedGravity(model, data, q)[columns]
    return torque


@dataclass(frozen=True, eq=False)
class KnownSides:
    """Known sides of the backlash, -1 or 1, on which a leg's joints lie.

    Attributes:
        legs: readings (n, 6) rad of these stances.
        sides: (n, 6).
    """

    legs: Array
    sides: Array

    def at(self, legs: Array, torque: Array) -> Array:
        """Sides (k, 6) at readings (k, 6) rad: known ones, or signs of the torques (k, 6) Nm in other stances."""
        away = np.abs(legs[:, None] - self.legs[None]).max(axis=-1)
        known = self.sides[away.argmin(axis=1)]
        return np.where(away.min(axis=1)[:, None] < _SAME_STANCE, known, np.sign(torque))


def gravity_gains(
    side: str, unknowns: NaoUnknowns, gravity: npt.ArrayLike, known: KnownSides | None = None
) -> Gains | None:
    """Return gains for compliance and backlash: gravity torques, Nm, and the side of each joint's backlash.

    Both are evaluated at the readings plus offsets.

    Args:
        side: L or R.
        unknowns: to be estimated.
        gravity: in the torso frame, (3,) m/s^2.
        known: sides of the backlash in stances; None if it changes smoothly over about `BACKLASH_NM`.
    """
    if not (unknowns.compliance or unknowns.backlash):
        return None
    offsets = [unknowns.names.index(f"{side}{joint}_deg") for joint in LEG]

    def gains(readings: Array, x: Array) -> dict[str, Array]:
        torque = gravity_torques(side, readings[:, :6] + x[offsets], gravity)
        lies = np.tanh(torque / BACKLASH_NM) if known is None else known.at(readings[:, :6], torque)
        torques = {f"torque {side}{joint}": torque[:, i] for i, joint in enumerate(LEG)}
        return torques | {f"backlash {side}{joint}": lies[:, i] for i, joint in enumerate(LEG)}

    return gains


def nao_sightings(
    side: str,
    unknowns: NaoUnknowns,
    stances: Indices,
    leg: Array,
    head: Array,
    board: Array,
    pixels: Array,
    gravity: Sequence[float],
) -> Sightings:
    """Images of the board on one sole.

    Args:
        side: L or R.
        unknowns: to be estimated.
        stances: (n,) of each image; images of one stance share one reading of the leg.
        leg, head: encoders, (n, 6) and (n, 2) rad.
        board: vertices (m, 3) m in the sole frame.
        pixels: (n, m, 2).
        gravity: in the torso frame, m/s^2.
    """
    images = np.arange(len(stances))
    ids = np.column_stack([np.tile(stances[:, None], (1, len(LEG))), images, images])
    return Sightings(
        nao_chain(side, unknowns),
        np.column_stack([leg, head]),
        ids,
        stances,
        board,
        pixels,
        gravity_gains(side, unknowns, np.asarray(gravity)),
    )


former_names(__name__, __name__, PLAY_NM="BACKLASH_NM")
