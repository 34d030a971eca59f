"""An independent judge: MuJoCo's own kinematics and collision of the same arm and bodies.

Nothing of the planner is used: the arm comes from the URDF through MuJoCo's parser, bodies as MuJoCo's own primitives
and convex meshes (whose corners it keeps in single precision: 6e-8 m at 1 m), and the motion as joint positions on a
1 ms grid. Distances have no margin; MuJoCo's convex collision runs to 1e-9 m, so they are good to 1e-6 m.
"""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np

from arm.robot.shapes import Body, Box, Capsule, Convex, Cylinder, Shape, Simple, Sphere, Torus, simple_parts


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
        cubes: name and edge length (or shape) of each cube.
        apart: pairs of arm bodies that are not checked (adjacent links).
    """

    def __init__(
        self,
        urdf: Path,
        bodies: Sequence[Body],
        cubes: Sequence[tuple[str, float | Shape]],
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
        self._static = set()
        for body in bodies:
            for index, (shape, at) in enumerate(simple_parts(body.shape)):
                name = f"{body.name} {index}" if isinstance(body.shape, Torus) else body.name
                self._static.add(name)
                spec.worldbody.add_geom(
                    name=name, **_shape(spec, name, shape), **_pose(body.T_base_body @ at)
                )
        self._mocap = {name: i for i, (name, _) in enumerate(cubes)}
        for name, size in cubes:
            holder = spec.worldbody.add_body(name=f"holder of {name}", mocap=True)
            ((shape, _),) = simple_parts(Box((size, size, size)) if isinstance(size, float | int) else size)
            holder.add_geom(name=name, **_shape(spec, name, shape))
        spec.option.ccd_tolerance = 1e-9
        spec.option.ccd_iterations = 200
        self.model = spec.compile()
        self.data = mujoco.MjData(self.model)
        self.model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_FILTERPARENT
        self._apart = apart
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
        found = self.data.contact  # its arrays: an object a contact costs ten times what finding it does
        for i in np.flatnonzero(found.dist < -tolerance):
            pair = frozenset(self._names[g] for g in found.geom[i])
            if pair not in self._apart and not pair <= self._static:
                yield pair, -float(found.dist[i])

    def distance(self, a: str, b: str, limit: float = 5.0) -> float:
        """Signed distance of two bodies, m, and `limit` where they are further apart."""
        ids = [self.model.geom(n).id for n in (a, b)]
        return float(mujoco.mj_geomDistance(self.model, self.data, *ids, limit, None))

    def pairs(self, held: str | None = None) -> list[tuple[str, str]]:
        """Pairs that can move against each other: not both still, nor both fixed to one joint, nor adjacent links.

        Cubes stand still but for `held`, which goes with the hand. The jaws count as fixed to the hand.
        """
        group = {name: self._group(i) for i, name in enumerate(self._names)}
        group.update(dict.fromkeys(self._mocap, 0))
        if held is not None:
            group[held] = group["palm"]
        return [
            (a, b)
            for i, a in enumerate(self._names)
            for b in self._names[i + 1 :]
            if group[a] != group[b] and frozenset((a, b)) not in self._apart
        ]

    def _group(self, geom: int) -> int:
        """The MuJoCo body with the last arm joint before a geom; 0 for the world."""
        body = int(self.model.geom_bodyid[geom])
        arm = {int(self.model.joint(f"J{i}").bodyid[0]) for i in range(1, 7)}
        while body and body not in arm:
            body = int(self.model.body_parentid[body])
        return body


def _pose(T: np.ndarray) -> dict[str, object]:
    quat = np.zeros(4)
    mujoco.mju_mat2Quat(quat, np.ascontiguousarray(T[:3, :3]).ravel())
    return {"pos": T[:3, 3], "quat": quat}


def _shape(spec: mujoco.MjSpec, name: str, shape: Simple) -> dict[str, object]:
    kinds = mujoco.mjtGeom
    match shape:
        case Box(size):
            return {"type": kinds.mjGEOM_BOX, "size": [s / 2 for s in size]}
        case Cylinder(radius, length):
            return {"type": kinds.mjGEOM_CYLINDER, "size": [radius, length / 2, 0]}
        case Capsule(radius, length):
            return {"type": kinds.mjGEOM_CAPSULE, "size": [radius, length / 2, 0]}
        case Sphere(radius):
            return {"type": kinds.mjGEOM_SPHERE, "size": [radius, 0, 0]}
        case Convex(points):
            spec.add_mesh(
                name=name, uservert=np.ravel(points), inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_CONVEX
            )
            return {"type": kinds.mjGEOM_MESH, "meshname": name}
