"""Serial URDF arms with a rigid tool: kinematics by Pinocchio, bodies as plain values.

The caller always states the tool, as a frame at the end of the chain and T_end_tool. Joints that are not part of the
arm (jaws) are locked at given positions.
"""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from arm.arguments import number, rigid, shown
from arm.errors import FileInputError, InputError
from arm.io.storage import LARGEST, data_file, read_text, sha256
from arm.numerics.products import mul, norm
from arm.robot.shapes import Body, Box, Capsule, Convex, Cylinder, Shape, Sphere, convex, shape_to_json
from arm.robot.urdf import SAME_NAME, parsed, read_disabled_collisions, read_urdf, with_followers
from arm.se3 import Array, frozen, transform

_LONGEST = 20.0  # m, mesh of a link: a long track; one in mm without a scale is longer
_SCALE = 'is it in mm? then the URDF gives it scale="0.001 0.001 0.001"'


@dataclass(frozen=True)
class LinkBody:
    """A collision body that moves with the arm.

    Attributes:
        name: name of its link, with a number for further bodies of one link.
        joint: index of the moving joint before it, 1 to n; 0 for the fixed base.
        shape: its shape.
        T_joint_body: pose in that joint's frame.
        padding: see `arm.robot.shapes.Body`, m.
        link: its link; "" for a body without one, such as a tool's.
    """

    name: str
    joint: int
    shape: Shape
    T_joint_body: Array
    padding: float = 0.0
    link: str = ""


@dataclass(frozen=True, eq=False)
class Robot:
    """An arm with a tool. Not thread-safe: it contains Pinocchio's workspace.

    Attributes:
        model: Pinocchio model of the moving joints, in the URDF's order.
        end_frame: name of the frame that carries the tool.
        T_end_tool: the tool frame in it.
        bodies: collision bodies.
        disabled_collisions: pairs of body names that are not checked against each other.
        digest: SHA-256 over URDF, SRDF, tool, locked joints and hulls of meshes.
        ideal: the nominal arm if this one is calibrated, for closed-form inverse kinematics; or None.
        urdf, srdf: text of the URDF, and of the SRDF if there is one.
        locked: positions of the joints that are locked, with those that follow them, m or rad.
    """

    model: Any
    end_frame: str
    T_end_tool: Array
    bodies: tuple[LinkBody, ...]
    disabled_collisions: frozenset[frozenset[str]]
    digest: str
    ideal: Robot | None = None
    urdf: str = ""
    srdf: str = ""
    locked: Mapping[str, float] = field(default_factory=dict)

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

    @property
    def end_joint(self) -> int:
        """Index of the joint that moves the end frame, 1 to n; 0 for a fixed one."""
        return int(self.model.frames[self._end].parentJoint)

    @property
    def T_joint_end(self) -> Array:
        """Pose (4x4) of the end frame in the frame of `end_joint`."""
        return frozen(self.model.frames[self._end].placement.homogeneous)

    def T_base_tool(self, q: npt.ArrayLike) -> Array:
        """Return the pose (4x4) of the tool at configuration q (n,) in rad."""
        pin.forwardKinematics(self.model, self._data, np.asarray(q, dtype=float))
        return frozen(
            mul(pin.updateFramePlacement(self.model, self._data, self._end).homogeneous, self.T_end_tool)
        )

    def jacobian(self, q: npt.ArrayLike) -> Array:
        """Return the Jacobian (6, n) of the tool's twist in tool axes: three rows of translation, three of rotation.

        T(q + dq) = T(q) exp(J dq) to first order (Pinocchio's LOCAL frame, moved to the tool).
        """
        J_end = pin.computeFrameJacobian(
            self.model, self._data, np.asarray(q, dtype=float), self._end, pin.ReferenceFrame.LOCAL
        )
        # Pinocchio returns a vector for an arm with one joint
        return np.asarray(mul(pin.SE3(self.T_end_tool).actionInverse, J_end.reshape(6, -1)))

    def joint_poses(self, q: npt.ArrayLike) -> Array:
        """Return the poses of the base (index 0) and of every joint frame, (n + 1, 4, 4)."""
        pin.forwardKinematics(self.model, self._data, np.asarray(q, dtype=float))
        return np.stack([M.homogeneous for M in self._data.oMi])

    def bodies_at(self, q: npt.ArrayLike) -> list[Body]:
        """Return the arm's bodies at configuration q."""
        poses = self.joint_poses(q)
        return [
            Body(b.name, b.shape, frozen(mul(poses[b.joint], b.T_joint_body)), "robot", b.padding)
            for b in self.bodies
        ]


def _links(urdf: ElementTree.Element) -> list[str]:
    return [link.get("name", "") for link in urdf.findall("./link")]


def load_robot(
    urdf: str | Path,
    end_frame: str,
    T_end_tool: npt.ArrayLike,
    locked: Mapping[str, float] | None = None,
    srdf: str | Path | None = None,
    package_dirs: Iterable[str | Path] = (),
    text: str | None = None,
) -> Robot:
    """Read an arm from a URDF, and its disabled collisions from an SRDF.

    A continuous joint gets a range of one revolution in each direction, which limits may narrow. A locked joint locks
    those that follow it (``<mimic>``), at the positions that its own gives them. A collision mesh is
    replaced by its convex hull, which contains it, so certificates for the hull hold for the mesh. `arm.robot.urdf`
    describes the search for mesh files. A cylinder named by ``<collision_checking><capsule name=.../>`` becomes a
    capsule, as in Pinocchio.

    Args:
        urdf: the file.
        end_frame: the frame that carries the tool, such as ``flange``.
        T_end_tool: the tool frame in it, 4x4, m.
        locked: positions of the joints to lock, m or rad.
        srdf: the file; default: that of the name of `urdf` beside it, in ``../srdf`` or in ``../config``, if any.
        package_dirs: folders that contain (or are) the packages of ``package://``.
        text: text to use instead of the content of `urdf`, which then only appears in messages.

    Raises:
        FileInputError: a given SRDF does not exist; the file is not a URDF, or is xacro; a body is not a box, cylinder,
            sphere, capsule or mesh (Pinocchio drops others silently, so the number of bodies is
            compared); or a mesh is missing, flat, or too small or large for an arm.
        InputError: an unknown frame or joint, or `urdf` is not a path.
    """
    tool = rigid("T_end_tool", T_end_tool)
    if not isinstance(urdf, str | Path):
        raise InputError(f"urdf = {shown(urdf)}: must be the path of a URDF file", name="urdf")
    urdf = Path(urdf)
    text, ready = read_urdf(urdf, package_dirs, text)
    at = {k: number(f"locked: {k}", value, -LARGEST, LARGEST) for k, value in dict(locked or {}).items()}
    locked = with_followers(urdf, text, at)
    full = parsed(urdf, lambda: pin.buildModelFromXML(ready))
    geometry = parsed(urdf, lambda: pin.buildGeomFromUrdfString(full, ready, pin.GeometryType.COLLISION))
    root = ElementTree.fromstring(text)
    wanted = len(root.findall("./link/collision"))
    if wanted != geometry.ngeoms:
        rule = f"only {geometry.ngeoms} were read; use cylinders, spheres, boxes and meshes"
        raise FileInputError(urdf, "collision", f"{wanted} bodies", rule)
    # names of joints in `full`, by those of the URDF
    names = {str(name).removesuffix(SAME_NAME): name for name in list(full.names)[1:]}
    unknown = [name for name in locked if name not in names]
    if unknown:
        rule = f"must be names of its joints, which are {', '.join(names)}"
        raise FileInputError(urdf, "locked", unknown, rule)
    if not isinstance(end_frame, str) or not full.existFrame(end_frame):
        rule = f"must be the name of one of its links, which are {', '.join(_links(root))}"
        raise FileInputError(urdf, "end_frame", end_frame, rule)
    reference = pin.neutral(full)
    for name, value in locked.items():
        reference[full.joints[full.getJointId(names[name])].idx_q] = value
    links = [str(full.frames[g.parentFrame].name) for g in geometry.geometryObjects]
    ids = [full.getJointId(names[name]) for name in locked]
    for placed, name in zip(full.jointPlacements[1:], list(full.names)[1:], strict=True):
        away = float(norm(placed.translation))
        if away > _LONGEST:
            rule = f"is {away:.0f} m from the joint before it; must be within {_LONGEST:g} m (is it in mm?)"
            raise FileInputError(urdf, f"joint {str(name).removesuffix(SAME_NAME)}: origin", None, rule)
    model, geometry = pin.buildReducedModel(full, geometry, ids, reference)
    for k in range(1, model.njoints):
        model.names[k] = str(model.names[k]).removesuffix(SAME_NAME)
    if model.nq != model.njoints - 1:
        raise FileInputError(urdf, "joint", None, "every moving joint must have one degree of freedom")
    aside = set(range(1, model.njoints)) - _moving(model, end_frame)
    if aside:
        still = [model.names[k] for k in sorted(aside)]
        listed = ", ".join(f"{name!r}: 0.0" for name in still)
        rule = f"does not move {end_frame}: lock all such joints where they are, such as locked={{{listed}}}"
        raise FileInputError(urdf, f"joint {still[0]}", None, rule)

    srdf = _srdf(urdf) if srdf is None else Path(srdf)
    srdf_text = "" if srdf is None else read_text(srdf)
    if srdf is not None and not srdf_text.strip():
        raise FileInputError(srdf, "", None, "is empty; must be an SRDF: it begins with <robot>")
    bodies = tuple(
        _link_body(urdf, g, link, name)
        for g, link, name in zip(geometry.geometryObjects, links, _names(links), strict=True)
    )
    identity = {"urdf": text, "srdf": srdf_text, "tool": tool.tolist(), "locked": locked}
    hulls = {b.name: shape_to_json(b.shape) for b in bodies if isinstance(b.shape, Convex)}
    if hulls:  # meshes are in files of their own
        identity["hulls"] = hulls
    return Robot(
        model=model,
        end_frame=end_frame,
        T_end_tool=tool,
        bodies=bodies,
        disabled_collisions=read_disabled_collisions(
            srdf or urdf, srdf_text, by_link(bodies), _links(root), root.get("name", "")
        ),
        digest=sha256(identity),
        urdf=text,
        srdf=srdf_text,
        locked=locked,
    )


def _moving(model: Any, frame: str) -> set[int]:
    """Return the indices of the joints that move a frame."""
    joint, found = int(model.frames[model.getFrameId(frame)].parentJoint), set[int]()
    while joint > 0:
        found.add(joint)
        joint = int(model.parents[joint])
    return found


def _srdf(urdf: Path) -> Path | None:
    """Return the SRDF that comes with a URDF: beside it, or where the packages of ROS and MoveIt have it; or None."""
    name, above = f"{urdf.stem}.srdf", urdf.absolute().parent.parent
    places = (urdf.with_name(name), above / "srdf" / name, above / "config" / name)
    return next((place for place in places if place.is_file()), None)


def by_link(bodies: Iterable[LinkBody]) -> dict[str, list[str]]:
    """Return the names of the bodies of each link."""
    found: dict[str, list[str]] = {}
    for body in bodies:
        found.setdefault(body.link or body.name, []).append(body.name)
    return found


def _names(links: Sequence[str]) -> list[str]:
    """Name bodies after their links, from the second on with a number, and never like another link."""
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
            vertices = shape.vertices()
            longest = float(np.ptp(vertices, axis=0).max()) if len(vertices) else 0.0
            if longest > _LONGEST:
                rule = f"is {longest:.4g} m long; the mesh of a link may be at most {_LONGEST:g} m long"
                raise FileInputError(urdf, f"link {name}", str(geometry.meshPath), rule, _SCALE)
            try:
                ours = convex(vertices)
            except InputError as error:
                rule = f"has no hull: {error}"
                raise FileInputError(urdf, f"link {name}", str(geometry.meshPath), rule) from error
        case other:
            raise FileInputError(urdf, f"link {name}", other, "must be a box, cylinder, sphere or mesh")
    pose = frozen(geometry.placement.homogeneous)
    return LinkBody(name, int(geometry.parentJoint), ours, pose, link=link)


def load_a465(
    tool_length: float, jaw_opening: float, urdf: Path | None = None, text: str | None = None
) -> Robot:
    """Return the A465 with its two-finger gripper.

    Args:
        tool_length: from the flange to the tool frame at the finger tips, m. It has no default, because programs for
            this arm differ by the 134.112 mm of gripper and fingers.
        jaw_opening: distance of the fingers' inner faces, m.
        urdf: another URDF with the same flange and jaws: links ``finger_l`` and ``finger_r``, each a box on a
            prismatic joint ``jaw_l``, ``jaw_r``, whose position is half of the opening.
        text: text to use instead of the shipped URDF (`arm.robot.gripper`).

    Raises:
        InputError: the fingers of the URDF do not end at `tool_length`, or cannot open that far.
    """
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
