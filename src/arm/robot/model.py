"""Any serial URDF arm with a rigid tool: kinematics by Pinocchio, bodies as plain values.

The tool is given, never implied: a frame at the end of the chain and T_end_tool. Joints that are not part of the
arm (jaws) are locked at stated positions.
"""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from arm.arguments import number, rigid
from arm.errors import FileInputError, InputError
from arm.io.storage import LARGEST, read_text, sha256
from arm.numerics.products import mul
from arm.robot.shapes import Body, Box, Capsule, Convex, Cylinder, Shape, Sphere, convex, shape_to_json
from arm.robot.urdf import read_touching, read_urdf
from arm.se3 import Array, frozen, transform


@dataclass(frozen=True)
class LinkBody:
    """A collision body that moves with the arm.

    Attributes:
        name: of its link; further bodies of one link have a number behind it.
        joint: index of the moving joint before it, 1 to n; 0 for the fixed base.
        shape: its shape.
        T_joint_body: pose in that joint's frame.
        padding: as of `arm.robot.shapes.Body`, m.
        link: that it is of; "" for a body of its own, such as a tool's.
    """

    name: str
    joint: int
    shape: Shape
    T_joint_body: Array
    padding: float = 0.0
    link: str = ""


@dataclass(frozen=True, eq=False)
class Robot:
    """An arm with a tool. Not for use from two threads at once (Pinocchio's workspace is inside).

    Attributes:
        model: Pinocchio model of the moving joints, in the URDF's order.
        end_frame: name of the frame that carries the tool.
        T_end_tool: the tool frame in it.
        bodies: collision bodies.
        touching: pairs of body names that are not checked against each other.
        digest: SHA-256 over URDF, SRDF, tool, locked joints and hulls of meshes.
        urdf: text of the description.
        ideal: the arm that this one is nearly, if it is a calibrated one: closed forms begin there.
    """

    model: Any
    end_frame: str
    T_end_tool: Array
    bodies: tuple[LinkBody, ...]
    touching: frozenset[frozenset[str]]
    digest: str
    ideal: Robot | None = None
    urdf: str = ""

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names of the moving joints."""
        return tuple(self.model.names)[1:]

    @cached_property
    def _data(self) -> Any:
        return self.model.createData()

    @cached_property
    def _end(self) -> int:
        return int(self.model.getFrameId(self.end_frame))

    def T_base_tool(self, q: npt.ArrayLike) -> Array:
        """Pose of the tool at configuration q (n,) in rad; 4x4."""
        pin.forwardKinematics(self.model, self._data, np.asarray(q, dtype=float))
        return frozen(
            mul(pin.updateFramePlacement(self.model, self._data, self._end).homogeneous, self.T_end_tool)
        )

    def jacobian(self, q: npt.ArrayLike) -> Array:
        """Twist of the tool in its own axes per joint speed, (6, n): three rows m/s, three rows rad/s.

        With T(q + dq) = T(q) exp(J dq) to first order (Pinocchio's LOCAL frame, moved to the tool).
        """
        J_end = pin.computeFrameJacobian(
            self.model, self._data, np.asarray(q, dtype=float), self._end, pin.ReferenceFrame.LOCAL
        )
        # of an arm with one joint Pinocchio makes a plain vector
        return np.asarray(mul(pin.SE3(self.T_end_tool).actionInverse, J_end.reshape(6, -1)))

    def joint_poses(self, q: npt.ArrayLike) -> Array:
        """Poses of the base (index 0) and of every joint frame, (n + 1, 4, 4)."""
        pin.forwardKinematics(self.model, self._data, np.asarray(q, dtype=float))
        return np.stack([M.homogeneous for M in self._data.oMi])

    def bodies_at(self, q: npt.ArrayLike) -> list[Body]:
        """The arm's bodies where they are at configuration q."""
        poses = self.joint_poses(q)
        return [
            Body(b.name, b.shape, frozen(mul(poses[b.joint], b.T_joint_body)), "robot", b.padding)
            for b in self.bodies
        ]


def load_robot(
    urdf: str | Path,
    end_frame: str,
    T_end_tool: npt.ArrayLike,
    locked: Mapping[str, float] | None = None,
    srdf: str | Path | None = None,
    package_dirs: Iterable[str | Path] = (),
    text: str | None = None,
) -> Robot:
    """Read an arm from URDF (and pairs not to check from SRDF, by default the file of the same stem).

    A continuous joint is one with a range of a turn each way, which limits may narrow.

    A collision mesh is taken as its convex hull, which is never smaller than the mesh: what is proved for the hull
    holds for the mesh. Where mesh files are looked for, ``package://`` too, is told by `arm.urdf`.
    A cylinder that ``<collision_checking><capsule name=.../>`` names is a capsule, as Pinocchio has it.

    Args:
        urdf: the file.
        end_frame: the frame that carries the tool, such as ``flange``.
        T_end_tool: the tool frame in it, 4x4, m.
        locked: position of each joint that is not to move, m or rad.
        srdf: the file; default: `urdf` with suffix ``.srdf`` if it exists.
        package_dirs: folders that hold packages (or are packages) which ``package://`` names.
        text: instead of what the file `urdf` says, which is then named in messages only.

    Raises:
        FileInputError: an SRDF that is given and not there; not a URDF that Pinocchio reads whole (xacro is none yet),
            or with a body of another shape than box, cylinder, sphere, capsule, mesh (Pinocchio drops others in
            silence, so the number of bodies is compared); or with a mesh that is not there, flat, or of a size that no
            arm has.
        InputError: an unknown frame or joint.
    """
    tool = rigid("T_end_tool", T_end_tool)
    urdf = Path(urdf)
    text, ready = read_urdf(urdf, package_dirs, text)
    locked = dict(locked or {})
    try:
        full = pin.buildModelFromXML(ready)
        geometry = pin.buildGeomFromUrdfString(full, ready, pin.GeometryType.COLLISION)
    except (ValueError, RuntimeError) as error:
        raise FileInputError(urdf, "", None, f"is not a URDF: {error}") from error
    wanted = len(ElementTree.fromstring(text).findall("./link/collision"))
    if wanted != geometry.ngeoms:
        raise FileInputError(
            urdf,
            "collision",
            f"{wanted} bodies",
            f"only {geometry.ngeoms} were read; use cylinders, spheres, boxes and meshes",
        )
    unknown = [name for name in locked if not full.existJointName(name)]
    if unknown or not isinstance(end_frame, str) or not full.existFrame(end_frame):
        raise InputError(
            f"{urdf}: no joint or frame named {', '.join(unknown) or end_frame!r}; "
            f"it has joints {', '.join(list(full.names)[1:])}",
            names=unknown or [end_frame],
        )
    reference = pin.neutral(full)
    for name, value in locked.items():
        reference[full.joints[full.getJointId(name)].idx_q] = number(
            f"locked: {name}", value, -LARGEST, LARGEST
        )
    links = [str(full.frames[g.parentFrame].name) for g in geometry.geometryObjects]
    try:
        full.getFrameId(end_frame)
        model, geometry = pin.buildReducedModel(
            full, geometry, [full.getJointId(n) for n in locked], reference
        )
    except ValueError as error:
        raise FileInputError(
            urdf, "", None, f"a joint and a link of one name cannot be told apart: {error}"
        ) from error
    if model.nq != model.njoints - 1:
        raise FileInputError(urdf, "joint", None, "every moving joint must have one degree of freedom")
    branching = [model.names[k] for k in range(1, model.njoints) if model.parents[k] != k - 1]
    if branching:
        raise FileInputError(
            urdf,
            f"joint {branching[0]}",
            None,
            "branches off; lock all moving joints that are not on the way to the tool",
        )

    given = srdf is not None
    srdf = Path(srdf or urdf.with_suffix(".srdf"))
    srdf_text = read_text(srdf) if given or srdf.is_file() else ""
    bodies = tuple(
        _link_body(urdf, g, link, name)
        for g, link, name in zip(geometry.geometryObjects, links, _names(links), strict=True)
    )
    identity = {"urdf": text, "srdf": srdf_text, "tool": tool.tolist(), "locked": locked}
    hulls = {b.name: shape_to_json(b.shape) for b in bodies if isinstance(b.shape, Convex)}
    if hulls:  # they come from other files than the URDF
        identity["hulls"] = hulls
    return Robot(
        model=model,
        end_frame=end_frame,
        T_end_tool=tool,
        bodies=bodies,
        touching=read_touching(srdf, srdf_text, by_link(bodies)),
        digest=sha256(identity),
        urdf=text,
    )


def by_link(bodies: Iterable[LinkBody]) -> dict[str, list[str]]:
    """Names of the bodies of each link."""
    found: dict[str, list[str]] = {}
    for body in bodies:
        found.setdefault(body.link or body.name, []).append(body.name)
    return found


def _names(links: Sequence[str]) -> list[str]:
    """Of bodies by their links: the link's, with a number from the second on that makes no name of another link."""
    names: list[str] = []
    for i, link in enumerate(links):
        before = links[:i].count(link)
        name = f"{link}_{before}" if before else link
        names.append(f"{link} body {before}" if before and name in links else name)
    return names


def _link_body(urdf: Path, geometry: Any, link: str, name: str) -> LinkBody:
    shape = geometry.geometry
    match type(shape).__name__:
        case "Box":
            x, y, z = (2.0 * float(h) for h in shape.halfSide)
            ours: Shape = Box((x, y, z))
        case "Cylinder":
            ours = Cylinder(float(shape.radius), 2.0 * float(shape.halfLength))
        case "Sphere":
            ours = Sphere(float(shape.radius))
        case "Capsule":
            ours = Capsule(float(shape.radius), 2.0 * float(shape.halfLength))
        case mesh if mesh.startswith("BVHModel"):
            try:
                ours = convex(shape.vertices())
            except InputError as error:
                raise FileInputError(
                    urdf, f"link {name}", str(geometry.meshPath), f"has no hull: {error}"
                ) from error
        case other:
            raise FileInputError(urdf, f"link {name}", other, "must be a box, cylinder, sphere or mesh")
    pose = frozen(geometry.placement.homogeneous)
    return LinkBody(name, int(geometry.parentJoint), ours, pose, link=link)


def load_a465(
    tool_length: float, jaw_opening: float, urdf: Path | None = None, text: str | None = None
) -> Robot:
    """The A465 with its two-finger gripper.

    Args:
        tool_length: from the flange to the tool frame at the finger tips, m; never implied, because
            programs for this arm differ by the 134.112 mm of gripper and fingers.
        jaw_opening: distance of the fingers' inner faces, m.
        urdf: another description with the same flange and jaws: links ``finger_l`` and ``finger_r``, each a box on a
            sliding joint ``jaw_l``, ``jaw_r``, whose position is half of the opening.
        text: instead of what the shipped description says (`arm.robot.gripper`).

    Raises:
        InputError: the fingers of the description do not end at `tool_length`, or cannot open that far.
    """
    from arm.io.storage import data_file

    path = urdf or data_file("urdf/a465/a465.urdf")
    half = jaw_opening / 2.0
    tool = transform(t=(0.0, 0.0, tool_length))
    robot = load_robot(path, "flange", tool, {"jaw_l": half, "jaw_r": half}, text=text)
    tips = [_tip_height(robot, b) for b in robot.bodies if b.name in ("finger_l", "finger_r")]
    if not tips or abs(max(tips) - tool_length) > 1e-6:
        raise InputError(
            f"tool length = {tool_length * 1e3:g} mm: the fingers in {path.name} end "
            f"{max(tips, default=0.0) * 1e3:g} mm beyond the flange; give that length, or measure your gripper",
            tool_length=tool_length,
        )
    return robot


def _tip_height(robot: Robot, body: LinkBody) -> float:
    flange = robot.model.frames[robot._end].placement.translation[2]
    length = body.shape.size[2] if isinstance(body.shape, Box) else 0.0
    return float(body.T_joint_body[2, 3] + length / 2.0 - flange)
