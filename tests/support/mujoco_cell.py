"""An independent judge: MuJoCo's own kinematics and collision of the same arm and bodies.

Nothing of the planner is used: the arm comes from the URDF through MuJoCo's parser, bodies as boxes, cylinders and
spheres, and the motion as joint positions on a 1 ms grid.
"""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np

from arm.bodies import Body, Box, Cylinder, Sphere


@dataclass(frozen=True)
class Penetration:
    """Two bodies inside each other by `depth` m at sample `index`."""

    index: int
    pair: frozenset[str]
    depth: float


class MujocoCell:
    """The arm with locked or moving jaws, bodies that stand still, and cubes that are put where they are.

    Args:
        urdf: of the arm.
        bodies: that stand still.
        cubes: name and edge length of each cube.
        apart: pairs of arm bodies that are not checked (adjacent links).
    """

    def __init__(
        self,
        urdf: Path,
        bodies: Sequence[Body],
        cubes: Sequence[tuple[str, float]],
        apart: frozenset[frozenset[str]],
    ) -> None:
        root = ElementTree.fromstring(urdf.read_text())
        for link in root.findall("link"):
            for collision in link.findall("collision"):
                collision.set("name", link.attrib["name"])
        extra = ElementTree.SubElement(root, "mujoco")
        settings = {"fusestatic": "true", "discardvisual": "false", "balanceinertia": "true"}
        ElementTree.SubElement(extra, "compiler", settings)

        for link in root.findall("link"):
            inertial = ElementTree.SubElement(link, "inertial")
            ElementTree.SubElement(inertial, "mass", {"value": "1"})
            inertia = {
                k: "0.01" if k in ("ixx", "iyy", "izz") else "0"
                for k in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
            }
            ElementTree.SubElement(inertial, "inertia", inertia)
        spec = mujoco.MjSpec.from_string(ElementTree.tostring(root, encoding="unicode"))
        for body in bodies:
            spec.worldbody.add_geom(name=body.name, **_geom(body))
        self._mocap = {name: i for i, (name, _) in enumerate(cubes)}
        for name, size in cubes:
            holder = spec.worldbody.add_body(name=f"holder of {name}", mocap=True)
            holder.add_geom(name=name, type=mujoco.mjtGeom.mjGEOM_BOX, size=[size / 2] * 3)
        self.model = spec.compile()
        self.data = mujoco.MjData(self.model)
        self.model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_FILTERPARENT
        self._apart = apart
        self._static = {body.name for body in bodies}
        self._joints = [self.model.joint(f"J{i}").qposadr[0] for i in range(1, 7)]
        self._jaws = [self.model.joint(n).qposadr[0] for n in ("jaw_l", "jaw_r")]
        self._names = [self.model.geom(i).name for i in range(self.model.ngeom)]

    def place(self, q: np.ndarray, jaw_opening: float, cubes: dict[str, np.ndarray]) -> None:
        """Put the arm at q (6,) rad, the fingers `jaw_opening` m apart, and cubes at T_base_cube."""
        self.data.qpos[self._joints] = q
        self.data.qpos[self._jaws] = jaw_opening / 2
        for name, T in cubes.items():
            self.data.mocap_pos[self._mocap[name]] = T[:3, 3]
            mujoco.mju_mat2Quat(
                self.data.mocap_quat[self._mocap[name]], np.ascontiguousarray(T[:3, :3]).ravel()
            )
        mujoco.mj_kinematics(self.model, self.data)

    def penetrations(self, tolerance: float = 1e-6) -> Iterable[tuple[frozenset[str], float]]:
        """Pairs inside each other by more than `tolerance` m where everything stands now."""
        mujoco.mj_collision(self.model, self.data)
        for contact in self.data.contact[: self.data.ncon]:
            if contact.dist < -tolerance:
                pair = frozenset(self._names[g] for g in contact.geom)
                if pair not in self._apart and not pair <= self._static:
                    yield pair, -float(contact.dist)

    def distance(self, a: str, b: str, limit: float = 1.0) -> float:
        """Signed distance of two bodies, m."""
        ids = [self.model.geom(n).id for n in (a, b)]
        return float(mujoco.mj_geomDistance(self.model, self.data, *ids, limit, None))


def _geom(body: Body) -> dict[str, object]:
    quat = np.zeros(4)
    mujoco.mju_mat2Quat(quat, np.ascontiguousarray(body.T_base_body[:3, :3]).ravel())
    match body.shape:
        case Box(size):
            shape: dict[str, object] = {"type": mujoco.mjtGeom.mjGEOM_BOX, "size": [s / 2 for s in size]}
        case Cylinder(radius, length):
            shape = {"type": mujoco.mjtGeom.mjGEOM_CYLINDER, "size": [radius, length / 2, 0]}
        case Sphere(radius):
            shape = {"type": mujoco.mjtGeom.mjGEOM_SPHERE, "size": [radius, 0, 0]}
    return {**shape, "pos": body.T_base_body[:3, 3], "quat": quat}
