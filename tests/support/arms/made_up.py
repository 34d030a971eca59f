"""Arms whose links are boxes, some with the kinematics of real ones; and MuJoCo as the judge of any of them."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Sequence
from pathlib import Path

import mujoco
import numpy as np

from arm.robot.model import Robot, load_robot
from arm.robot.shapes import Body, simple_parts
from arm.robot.tool import with_disabled_collisions
from arm.se3 import transform
from arms.mujoco_cell import _pose, _shape

# origin xyz, origin rpy, axis, kind, lower, upper
Joint = tuple[str, str, str, str, float, float]
X, Y, Z = "1 0 0", "0 1 0", "0 0 1"
HALF_TURN = "1.5707963267948966"
UR_LIKE = [  # three parallel axes, and a wrist whose axes do not meet
    ("0 0 0.15", "0 0 0", Z, "revolute", -6.2, 6.2),
    ("0 0.12 0", f"0 {HALF_TURN} 0", Y, "revolute", -6.2, 6.2),
    ("0 -0.1 0.4", "0 0 0", Y, "revolute", -2.8, 2.8),
    ("0 0 0.37", f"0 {HALF_TURN} 0", Y, "revolute", -6.2, 6.2),
    ("0 0.11 0", "0 0 0", Z, "continuous", 0, 0),
    ("0 0 0.11", "0 0 0", Y, "revolute", -6.2, 6.2),
]
SEVEN = [
    ("0 0 0.32", "0 0 0", Z, "revolute", -2.8, 2.8),
    ("0 0 0", "0 0 0", Y, "revolute", -2.0, 2.0),
    ("0 0 0.38", "0 0 0", Z, "revolute", -2.8, 2.8),
    ("0 0 0", "0 0 0", Y, "revolute", -2.2, 2.2),
    ("0 0 0.36", "0 0 0", Z, "revolute", -2.8, 2.8),
    ("0 0 0", "0 0 0", Y, "revolute", -2.0, 2.0),
    ("0 0 0.1", "0 0 0", Z, "revolute", -2.8, 2.8),
]
RAIL = [  # a carriage, then five turns: the tool can do all but turn about its own axis as it likes
    ("0 0 0.05", "0 0 0", Y, "prismatic", -0.6, 0.6),
    ("0 0 0.2", "0 0 0", Z, "revolute", -3.0, 3.0),
    ("0 0 0.08", "0 0 0", Y, "revolute", -2.0, 2.0),
    ("0 0 0.33", "0 0 0", Y, "revolute", -2.5, 2.5),
    ("0 0 0.3", "0 0 0", Y, "revolute", -2.1, 2.1),
]
# Data sheets: joints of arms that many have. The packages with their meshes weigh 130 and 90 MB.
UR5 = [
    ("0 0 0.089159", "0 0 0", Z, "revolute", -6.28, 6.28),
    ("0 0.13585 0", f"0 {HALF_TURN} 0", Y, "revolute", -6.28, 6.28),
    ("0 -0.1197 0.425", "0 0 0", Y, "revolute", -3.14, 3.14),
    ("0 0 0.39225", f"0 {HALF_TURN} 0", Y, "revolute", -6.28, 6.28),
    ("0 0.093 0", "0 0 0", Z, "revolute", -6.28, 6.28),
    ("0 0 0.09465", "0 0 0", Y, "revolute", -6.28, 6.28),
]
PANDA = [
    ("0 0 0.333", "0 0 0", Z, "revolute", -2.8973, 2.8973),
    ("0 0 0", f"-{HALF_TURN} 0 0", Z, "revolute", -1.7628, 1.7628),
    ("0 -0.316 0", f"{HALF_TURN} 0 0", Z, "revolute", -2.8973, 2.8973),
    ("0.0825 0 0", f"{HALF_TURN} 0 0", Z, "revolute", -3.0718, -0.0698),
    ("-0.0825 0.384 0", f"-{HALF_TURN} 0 0", Z, "revolute", -2.8973, 2.8973),
    ("0 0 0", f"{HALF_TURN} 0 0", Z, "revolute", -0.0175, 3.7525),
    ("0.088 0 0", f"{HALF_TURN} 0 0", Z, "revolute", -2.8973, 2.8973),
]
XARM7 = [  # every other joint turns endlessly
    ("0 0 0.267", "0 0 0", Z, "continuous", 0, 0),
    ("0 0 0", f"-{HALF_TURN} 0 0", Z, "revolute", -2.059, 2.0944),
    ("0 -0.293 0", f"{HALF_TURN} 0 0", Z, "continuous", 0, 0),
    ("0.0525 0 0", f"{HALF_TURN} 0 0", Z, "revolute", -0.19198, 3.927),
    ("0.0775 -0.3425 0", f"{HALF_TURN} 0 0", Z, "continuous", 0, 0),
    ("0 0 0", f"{HALF_TURN} 0 0", Z, "revolute", -1.69297, 3.1416),
    ("0.076 0.097 0", f"-{HALF_TURN} 0 0", Z, "continuous", 0, 0),
]
THICK = 0.06


BOX_OBJ = "\n".join(f"v {x} {y} {z}" for x in (0, 0.1) for y in (0, 0.2) for z in (0, 0.3))
BOX_OBJ += "\nf 1 2 4 3\nf 5 7 8 6\nf 1 5 6 2\nf 3 4 8 7\nf 1 3 7 5\nf 2 6 8 4\n"
MESH_ARM = """<robot name="two">
<link name="foot"><collision><origin xyz="0 0 1"/>
<geometry><mesh filename="{mesh}" scale="2 1 1"/></geometry></collision></link>
<link name="rod"><collision name="skin"><geometry><cylinder radius="0.1" length="0.5"/></geometry></collision>
<collision_checking><capsule name="skin"/></collision_checking></link>
<joint name="J1" type="revolute"><parent link="foot"/><child link="rod"/><axis xyz="0 0 1"/>
<limit lower="-1" upper="1" effort="1" velocity="1"/></joint></robot>"""


def several_bodies(text: str, count: int) -> str:
    """The URDF with the box of every link in `count` slices of its longest edge; none are named."""
    root = ElementTree.fromstring(text)
    for link in root.findall("link"):
        for collision in link.findall("collision"):
            link.remove(collision)
            origin, box = collision.find("origin"), collision.find("geometry/box")
            if origin is None or box is None:
                raise ValueError(f"link {link.get('name')} is no box with an origin")
            middle, size = (
                np.array([float(v) for v in x.split()]) for x in (origin.attrib["xyz"], box.attrib["size"])
            )
            axis = int(np.argmax(size))
            step = np.zeros(3)
            step[axis] = size[axis] / count
            for k in range(count):
                at = middle + (k - (count - 1) / 2.0) * step
                part = np.where(np.arange(3) == axis, size / count, size)
                link.append(
                    ElementTree.fromstring(
                        f'<collision><origin xyz="{" ".join(f"{v:.9g}" for v in at)}"/><geometry>'
                        f'<box size="{" ".join(f"{v:.9g}" for v in part)}"/></geometry></collision>'
                    )
                )
    return ElementTree.tostring(root, encoding="unicode")


def urdf(joints: Sequence[Joint], tip: str = "0 0 0.06") -> str:
    """Text of the URDF: links l0, l1, .. as boxes from each joint to the next, joints q1, q2, .."""
    offsets = [*(xyz for xyz, *_ in joints), tip]
    links = ""
    for k, offset in enumerate(offsets):
        v = np.array([float(x) for x in offset.split()])
        size = " ".join(f"{abs(x) + THICK:.6g}" for x in v)
        middle = " ".join(f"{x / 2:.6g}" for x in v)
        links += (
            f'<link name="l{k}"><collision><origin xyz="{middle}"/><geometry><box size="{size}"/></geometry>'
            "</collision></link>"
        )
    chain = "".join(
        f'<joint name="q{k + 1}" type="{kind}"><parent link="l{k}"/><child link="l{k + 1}"/>'
        f'<origin xyz="{xyz}" rpy="{rpy}"/><axis xyz="{axis}"/>'
        f'<limit lower="{low}" upper="{high}" velocity="{0.5 if kind == "prismatic" else 1.5}" effort="1"/></joint>'
        for k, (xyz, rpy, axis, kind, low, high) in enumerate(joints)
    )
    return f'<robot name="made_up">{links}{chain}</robot>'


def arm(
    folder: Path,
    joints: Sequence[Joint],
    overlapping: Sequence[tuple[str, str]] = (),
) -> Robot:
    """The arm, its tool frame at the tip; links that always overlap are not checked."""
    path = folder / "arm.urdf"
    path.write_text(urdf(joints))
    robot = load_robot(path, f"l{len(joints)}", transform(t=(0.0, 0.0, 0.1)))
    return with_disabled_collisions(robot, overlapping, neighbours=True)


class MujocoArm:
    """One arm from its URDF and bodies around it; what moves with the tool is placed by hand."""

    def __init__(self, path: Path, robot: Robot, bodies: Sequence[Body]) -> None:
        root = ElementTree.fromstring(path.read_text())
        for link in root.findall("link"):
            for collision in link.findall("collision"):
                collision.set("name", link.attrib["name"])
            inertial = ElementTree.SubElement(link, "inertial")
            ElementTree.SubElement(inertial, "mass", {"value": "1"})
            inertia = dict.fromkeys(("ixy", "ixz", "iyz"), "0") | dict.fromkeys(("ixx", "iyy", "izz"), "0.01")
            ElementTree.SubElement(inertial, "inertia", inertia)
        extra = ElementTree.SubElement(root, "mujoco")
        ElementTree.SubElement(extra, "compiler", {"fusestatic": "true", "discardvisual": "false"})
        spec = mujoco.MjSpec.from_string(ElementTree.tostring(root, encoding="unicode"))
        for body in bodies:
            holder = spec.worldbody.add_body(name=f"holder of {body.name}", mocap=True)
            ((shape, _),) = simple_parts(body.shape)
            holder.add_geom(name=body.name, **_shape(spec, body.name, shape))
        spec.option.ccd_tolerance = 1e-9
        spec.option.ccd_iterations = 200
        self.model = spec.compile()
        self.data = mujoco.MjData(self.model)
        self.joints = [self.model.joint(name).qposadr[0] for name in robot.joint_names]
        self.links = [b.name for b in robot.bodies]
        self.disabled_collisions, self.bodies = robot.disabled_collisions, {b.name: b for b in bodies}
        self.mocap = {body.name: i for i, body in enumerate(bodies)}

    def least(
        self,
        q: np.ndarray,
        held: str | None = None,
        moved: dict[str, np.ndarray] | None = None,
        allowed: frozenset[frozenset[str]] = frozenset(),
        limit: float = 0.1,
    ) -> float:
        """Smallest distance m at q, at most `limit`; `moved` bodies stand at other poses, `held` goes with the tool."""
        self.data.qpos[self.joints] = q
        for name, body in self.bodies.items():
            pose = _pose((moved or {}).get(name, body.T_base_body))
            self.data.mocap_pos[self.mocap[name]] = pose["pos"]
            self.data.mocap_quat[self.mocap[name]] = pose["quat"]
        mujoco.mj_kinematics(self.model, self.data)
        still = [name for name in self.bodies if name != held]
        # what is held goes with the last link and is not checked against it
        pairs = [(a, b) for i, a in enumerate(self.links) for b in self.links[i + 1 :]]
        pairs += [(a, b) for a in self.links for b in still if a != "l0"]
        if held is not None:
            pairs += [(a, held) for a in [*self.links[:-1], *still]]
        return min(
            float(
                mujoco.mj_geomDistance(
                    self.model, self.data, self.model.geom(a).id, self.model.geom(b).id, limit, None
                )
            )
            for a, b in pairs
            if frozenset((a, b)) not in self.disabled_collisions | allowed
        )
