"""The cell as a MuJoCo model: cubes, plates on their stands, the hand, and what stands still."""

from __future__ import annotations

from collections.abc import Sequence
from importlib import import_module
from types import ModuleType
from typing import Any

import numpy as np

from arm.errors import InputError
from arm.numerics.products import mul
from arm.robot.gripper import HAND
from arm.robot.model import Robot
from arm.robot.shapes import Body, Box, Capsule, Convex, Cylinder, Simple, Sphere, Torus, simple_parts
from arm.se3 import Array, inverse, transform
from cell.contact.plate import plate_pieces
from cell.files.world import TrueBoard
from cell.files.world_errors import ContactKeys
from cell.sim.cubes import SimulatedCube

STEP_S = 0.002
SPARE = 5e-4  # m, by which fingers can open further than their ADC reads
FOOT = 0.003  # m, radius of the feet on which a plate stands
HAND_MASS, HAND_INERTIA = (
    3.0,
    0.02,
)  # kg, kg m^2: what of the arm moves with the hand; it is felt in impacts only
FINGER_MASS, DRIVE_INERTIA = 0.05, 0.2  # kg, the latter what of the motor a finger feels
FULL_FORCE = 2e-3  # m from its target from which on the drive pulls with all its force
STIFF = [0.004, 1.0]  # s and ratio of critical damping: how contacts and the jaws' coupling give way
NEAR_RIGID = [0.98, 0.999, 0.0002, 0.5, 2.0]
_ARM, _STILL = 1, 2  # bits: what moves collides with all, what stands still with cubes and hand alone


def load_mujoco() -> ModuleType:
    """Import MuJoCo.

    Raises:
        InputError: it is not installed.
    """
    try:
        return import_module("mujoco")
    except ImportError:
        why = "--cell mujoco: needs MuJoCo, which is not installed; make contact, or pip install 'a465[contact]'"
        raise InputError(why, option="--cell") from None


class Builder:
    """Collects the bodies of a model.

    Args:
        mujoco: the library.
        keys: physical constants.
    """

    def __init__(self, mujoco: ModuleType, keys: ContactKeys) -> None:
        self._mj, self._keys = mujoco, keys
        self.spec = spec = mujoco.MjSpec()
        option = spec.option
        option.timestep, option.cone, option.impratio = STEP_S, mujoco.mjtCone.mjCONE_ELLIPTIC, 10.0
        option.noslip_iterations = 4
        option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
        option.enableflags |= mujoco.mjtEnableBit.mjENBL_SLEEP

    def add_still(self, bodies: Sequence[Body]) -> None:
        """Add bodies that never move."""
        for body in bodies:
            for index, (part, at) in enumerate(simple_parts(body.shape)):
                name = f"{body.name} {index}" if isinstance(body.shape, Torus) else body.name
                pose = mul(body.T_base_body, at)
                self._geom(self.spec.worldbody, name, part, pose, self._keys.friction, _STILL)

    def add_cube(self, cube: SimulatedCube) -> None:
        """Add a cube where it is."""
        body = self._body(cube.name, cube.T_base_cube)
        geom = self._geom(
            body, cube.name, Box((cube.size,) * 3), transform(), self._keys.friction, _ARM | _STILL
        )
        geom.mass = self._keys.cube_mass

    def add_plate(self, name: str, b: TrueBoard) -> None:
        """Add a plate on its stand: an inclined plane, on which it may slide on four feet."""
        body = self._body(name, b.T_base_board)
        (x, y), (a, c, h) = b.board.plate.centre, b.board.plate.size
        body.explicitinertial, body.mass, body.ipos = True, self._keys.plate_mass, (x, y, -h / 2.0)
        body.inertia = self._keys.plate_mass / 12.0 * np.array([c * c + h * h, a * a + h * h, a * a + c * c])
        for index, piece in enumerate(plate_pieces(b.board)):
            at = transform(t=piece.centre)
            self._geom(body, f"{name} {index}", piece.shape, at, self._keys.friction, _ARM)
        under = transform(t=(x, y, -h))
        plane = self.spec.worldbody.add_geom(
            name=f"{name} stand",
            type=self._mj.mjtGeom.mjGEOM_PLANE,
            size=(0.5, 0.5, 0.1),
            contype=0,
            conaffinity=0,
            **self._pose(mul(b.T_base_board, under)),
        )
        for sx in (-1, 1):
            for sy in (-1, 1):
                at = transform(t=(x + sx * (a / 2.0 - FOOT), y + sy * (c / 2.0 - FOOT), FOOT - h))
                foot = self._geom(body, f"{name} foot {sx} {sy}", Sphere(FOOT), at, 1.0, 0)
                friction = [self._keys.stand_friction] * 2 + [0.005, 0.0001, 0.0001]
                self.spec.add_pair(
                    geomname1=foot.name,
                    geomname2=plane.name,
                    friction=friction,
                    condim=3,
                    solref=STIFF,
                    solimp=NEAR_RIGID,
                )

    def add_hand(self, robot: Robot, opening: float) -> None:
        """Add the hand, open: a free body with its frame at the tool, and two coupled fingers on it."""
        q = np.zeros(6)
        T_tool_base = inverse(robot.T_base_tool(q))
        parts = {b.name: b for b in robot.bodies_at(q) if b.name in HAND}
        hand = self._body("hand", transform(t=(0.0, 0.0, 1.0)))
        hand.gravcomp, hand.explicitinertial, hand.mass = 1.0, True, HAND_MASS
        hand.inertia, hand.ipos = (HAND_INERTIA,) * 3, (0.0, 0.0, 0.0)
        hand.sleep = self._mj.mjtSleepPolicy.mjSLEEP_NEVER
        for name, part in parts.items():
            at = mul(T_tool_base, part.T_base_body)
            holder = hand
            if name.startswith("finger"):
                side = 1.0 if at[1, 3] > 0.0 else -1.0
                holder = hand.add_body(name=name, gravcomp=1.0)
                holder.explicitinertial, holder.mass, holder.inertia = True, FINGER_MASS, (1e-5,) * 3
                holder.ipos = (0.0, 0.0, 0.0)
                holder.add_joint(
                    name=name,
                    type=self._mj.mjtJoint.mjJNT_SLIDE,
                    axis=(0.0, side, 0.0),
                    armature=DRIVE_INERTIA,
                    limited=True,
                    range=(0.0, opening / 2.0 + SPARE),
                )
                at = mul(transform(t=(0.0, -side * opening / 2.0, 0.0)), at)
            ((shape, _),) = simple_parts(part.shape)
            geom = self._geom(holder, name, shape, at, self._keys.jaw_friction, _ARM | _STILL)
            geom.priority, geom.mass = 1, 0.0
        self._add_drive([n for n in parts if n.startswith("finger")])

    def _add_drive(self, fingers: list[str]) -> None:
        """One motor drives both fingers; what holds one back holds back the other."""
        mj, force = self._mj, self._keys.jaw_force
        coupling = self.spec.add_equality(
            name="jaws",
            type=mj.mjtEq.mjEQ_JOINT,
            objtype=mj.mjtObj.mjOBJ_JOINT,
            name1=fingers[0],
            name2=fingers[1],
            solref=STIFF,
            solimp=NEAR_RIGID,
        )
        coupling.data[:5] = (0.0, 1.0, 0.0, 0.0, 0.0)
        tendon = self.spec.add_tendon(name="opening")
        for finger in fingers:
            tendon.wrap_joint(finger, 1.0)
        drive = self.spec.add_actuator(
            name="jaws",
            trntype=mj.mjtTrn.mjTRN_TENDON,
            target="opening",
            forcelimited=True,
            forcerange=(-force, force),
        )
        stiffness = force / FULL_FORCE
        drive.set_to_position(kp=stiffness, kv=np.sqrt(2.0 * stiffness * (FINGER_MASS + DRIVE_INERTIA)))

    def _body(self, name: str, T_base_body: Array) -> Any:
        body = self.spec.worldbody.add_body(name=name, **self._pose(T_base_body))
        body.add_freejoint()
        return body

    def _geom(self, holder: Any, name: str, shape: Simple, at: Array, friction: float, bits: int) -> Any:
        return holder.add_geom(
            name=name,
            friction=(friction, 0.005, 0.0001),
            contype=bits,
            conaffinity=bits,
            solref=STIFF,
            solimp=NEAR_RIGID,
            **self._shape(name, shape),
            **self._pose(at),
        )

    def _pose(self, T: Array) -> dict[str, Any]:
        quat = np.zeros(4)
        self._mj.mju_mat2Quat(quat, np.ascontiguousarray(T[:3, :3]).ravel())
        return {"pos": T[:3, 3], "quat": quat}

    def _shape(self, name: str, shape: Simple) -> dict[str, Any]:
        kinds = self._mj.mjtGeom
        match shape:
            case Box(size):
                return {"type": kinds.mjGEOM_BOX, "size": [s / 2.0 for s in size]}
            case Cylinder(radius, length):
                return {"type": kinds.mjGEOM_CYLINDER, "size": [radius, length / 2.0, 0.0]}
            case Capsule(radius, length):
                return {"type": kinds.mjGEOM_CAPSULE, "size": [radius, length / 2.0, 0.0]}
            case Sphere(radius):
                return {"type": kinds.mjGEOM_SPHERE, "size": [radius, 0.0, 0.0]}
            case Convex(points):
                inertia = self._mj.mjtMeshInertia.mjMESH_INERTIA_CONVEX
                self.spec.add_mesh(name=name, uservert=np.ravel(points), inertia=inertia)
                return {"type": kinds.mjGEOM_MESH, "meshname": name}
