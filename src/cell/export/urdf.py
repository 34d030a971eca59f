"""Export an arm and the bodies around it as URDF and SRDF, with convex hulls as mesh files.

The links, joints and jaws are those of the arm's own description. Joint origins are those of the exported arm, so a
calibrated arm keeps its corrections. Joint limits are those of planning. Every body is a link fixed to the base, or to
the tool if it is held, or to the end of the arm if it is part of the tool. A mesh of the arm becomes the hull that is
checked. A capsule, which URDF does not have, becomes a cylinder and two spheres in one link; a torus becomes capsules.
"""

from __future__ import annotations

import json
import re
import struct
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterable, Mapping
from copy import deepcopy
from dataclasses import dataclass, field
from itertools import combinations
from xml.etree.ElementTree import Element, SubElement

import numpy as np

from arm.controller.unit import Limits
from arm.errors import InputError
from arm.numerics.products import mul
from arm.robot.model import Robot
from arm.robot.shapes import Body, Box, Capsule, Convex, Cylinder, Simple, Sphere, hull_faces, simple_parts
from arm.se3 import Array, frozen, inverse, rot_y, rot_z, transform
from cell.export.link_tree import base_link, end_link, links_beyond, urdf_root
from plan.collision.world import World

URDF, SRDF, MESHES = "cell.urdf", "cell.srdf", "meshes"
TOOL = "tool"
COLOURS = {  # red, green, blue and opacity of bodies by kind, 0 to 1, for display
    "robot": (0.36, 0.42, 0.5, 1.0),
    "table": (0.82, 0.78, 0.7, 0.6),
    "board": (0.93, 0.93, 0.9, 1.0),
    "cube": (0.8, 0.36, 0.2, 1.0),
    "part": (0.8, 0.36, 0.2, 1.0),
    "": (0.72, 0.74, 0.77, 1.0),  # of any other kind
}
_COPIED = ("origin", "geometry")  # parts that a visual element copies from a collision element
Pair = frozenset[str]


@dataclass(frozen=True, eq=False)
class Surroundings:
    """Content of an export.

    Attributes:
        robot: the arm with its tool and the jaws where they are locked.
        limits: of its joints.
        bodies: static bodies.
        held: body in the jaws, or None.
        T_tool_held: its pose in the tool frame, 4x4.
        allowed: allowed collisions, pairs of names.
        states: named configurations, (n,) rad.
        padding: subtracted from every distance in collision checks, m; URDF cannot state it.
    """

    robot: Robot
    limits: Limits
    bodies: tuple[Body, ...]
    held: Body | None = None
    T_tool_held: Array = field(default_factory=transform)
    allowed: frozenset[Pair] = frozenset()
    states: Mapping[str, Array] = field(default_factory=dict)
    padding: float = 0.0

    def paddings(self) -> dict[str, float]:
        """Return the padding of each body that has one, m."""
        bodies = self.bodies if self.held is None else (*self.bodies, self.held)
        paddings = [(b.name, b.padding) for b in self.robot.bodies] + [(b.name, b.padding) for b in bodies]
        return {name: padding for name, padding in paddings if padding}


@dataclass(frozen=True)
class Description:
    """The files of an export.

    Attributes:
        files: relative name to content.
        links: name of each body that is not part of the arm to its link.
        disabled: disabled collisions, pairs of links.
    """

    files: Mapping[str, bytes | str]
    links: Mapping[str, str]
    disabled: tuple[tuple[str, str], ...]


def describe(there: Surroundings) -> Description:
    """Create the files of an export.

    Raises:
        InputError: two bodies have the same name, or the arm has no URDF that describes it.
    """
    robot = there.robot
    root = urdf_root(robot)
    root.set("name", f"{root.get('name', 'arm')}_cell")
    _place_joints(root, robot)
    _limit_joints(root, there)
    own = {str(link.get("name")) for link in root.iter("link")}
    base, end = base_link(root), end_link(root, robot)
    hand = links_beyond(root, end)
    tool = link_names([TOOL], own)[TOOL]
    _fixed(root, tool, end, robot.T_end_tool)
    T_end_joint = inverse(robot.T_joint_end)
    placed = [
        *(
            (Body(b.name, b.shape, frozen(T_end_joint @ b.T_joint_body), "tool"), end)
            for b in robot.bodies
            if not b.link
        ),
        *((body, base) for body in there.bodies),
        *([] if there.held is None else [(there.held.at(there.T_tool_held), tool)]),
    ]
    links = link_names([body.name for body, _ in placed], {*own, tool})
    meshes = _with_hulls(root, robot)
    for body, parent in placed:
        _add_body(root, body, links[body.name], parent, body.T_base_body, meshes)
    kinds = {links[body.name]: body.kind for body, parent in placed if parent in (base, tool)}
    for kind, colour in COLOURS.items():
        material = SubElement(root, "material", {"name": f"a465_{kind or 'other'}"})
        SubElement(material, "color", {"rgba": _numbers(colour)})
    for link in root.iter("link"):
        kind = kinds.get(str(link.get("name")), "robot")
        _show(link, kind if kind in COLOURS else "")
    disabled = _disabled(there, {**{b.name: b.link for b in robot.bodies if b.link}, **links})
    semantics = _semantics(there, disabled, (base, end, tool), hand)
    semantics.set("name", str(root.get("name")))
    files: dict[str, bytes | str] = {URDF: _text(root), SRDF: _text(semantics), **meshes}
    return Description(files, links, tuple(disabled))


def _with_hulls(root: Element, robot: Robot) -> dict[str, bytes]:
    """Put the hulls that are checked in place of the arm's meshes; return them as files."""
    files: dict[str, bytes] = {}
    names = link_names([body.name for body in robot.bodies], ())
    for link in root.iterfind("link"):
        bodies = [body for body in robot.bodies if body.link == link.get("name")]
        collisions = link.findall("collision")
        if len(collisions) != len(bodies):
            why = f"the arm's URDF: link {link.get('name')} has {len(collisions)} bodies, the arm has {len(bodies)}"
            raise InputError(why, link=link.get("name"))
        for collision, body in zip(collisions, bodies, strict=True):
            geometry = collision.find("geometry")
            mesh = None if geometry is None else geometry.find("mesh")
            if mesh is None or not isinstance(body.shape, Convex):
                continue
            name = f"{MESHES}/arm/{names[body.name]}.stl"
            files[name] = stl_of(body.shape)
            mesh.attrib.clear()  # its scale too, which the hull has
            mesh.set("filename", name)
        for visual in link.findall("visual"):
            if visual.find("geometry/mesh") is not None:  # elsewhere its file would not be found
                link.remove(visual)
    return files


def link_names(names: Iterable[str], taken: Iterable[str]) -> dict[str, str]:
    """Return a unique link name for each body, of letters, digits and underscores, none of `taken`.

    Raises:
        InputError: two bodies have the same name.
    """
    used, found = set(taken), dict[str, str]()
    for name in names:
        if name in found:
            raise InputError(f"two bodies are named {name!r}; names must differ", name=name)
        plain = re.sub(r"[^A-Za-z0-9_]", "_", name)
        link, number = plain, 1
        while link in used:
            number += 1
            link = f"{plain}_{number}"
        used.add(link)
        found[name] = link
    return found


def _place_joints(root: Element, robot: Robot) -> None:
    """Set the joint origins of a calibrated arm; a nominal arm keeps those of its description."""
    if robot.ideal is None:
        return
    for number, name in enumerate(robot.joint_names, start=1):
        joint = _joint(root, name)
        for old in joint.findall("origin"):
            joint.remove(old)
        joint.insert(0, _origin(robot.model.jointPlacements[number].homogeneous))


def _limit_joints(root: Element, there: Surroundings) -> None:
    limits = there.limits
    for k, name in enumerate(there.robot.joint_names):
        joint = _joint(root, name)
        if joint.get("type") == "continuous":
            joint.set("type", "revolute")
        limit = joint.find("limit")
        if limit is None:
            limit = SubElement(joint, "limit", {"effort": "0"})
        for key, value in (("lower", limits.lower), ("upper", limits.upper), ("velocity", limits.velocity)):
            limit.set(key, repr(float(value[k])))


def _joint(root: Element, name: str) -> Element:
    found = root.find(f"joint[@name='{name}']")
    if found is None:
        raise InputError(f"the arm's URDF has no joint {name}", joint=name)
    return found


def _add_body(
    root: Element, body: Body, link: str, parent: str, T_parent_body: Array, meshes: dict[str, bytes]
) -> None:
    if link != body.name:
        # as JSON, because a comment may contain neither control characters nor two dashes
        root.append(ElementTree.Comment(f" {json.dumps(body.name).replace('--', '- -')} "))
    _fixed(root, link, parent, T_parent_body)
    element = root.findall("link")[-1]
    for part, T_body_part in simple_parts(body.shape):
        match part:
            case Capsule(radius, length):
                _collide(element, Cylinder(radius, length), "", T_body_part)
                for end in (-length / 2.0, length / 2.0):
                    _collide(element, Sphere(radius), "", mul(T_body_part, transform(t=(0.0, 0.0, end))))
            case Convex():
                mesh = f"{MESHES}/{link}.stl"
                meshes[mesh] = stl_of(part)
                _collide(element, part, mesh, T_body_part)
            case _:
                _collide(element, part, "", T_body_part)


def _fixed(root: Element, link: str, parent: str, T_parent_link: Array) -> None:
    joint = SubElement(root, "joint", {"name": f"{link}_fixed", "type": "fixed"})
    SubElement(joint, "parent", {"link": parent})
    SubElement(joint, "child", {"link": link})
    joint.append(_origin(T_parent_link))
    SubElement(root, "link", {"name": link})


def _collide(link: Element, shape: Simple, mesh: str, T_link_shape: Array) -> None:
    collision = SubElement(link, "collision")
    if not np.array_equal(T_link_shape, np.eye(4)):
        collision.append(_origin(T_link_shape))
    geometry = SubElement(collision, "geometry")
    match shape:
        case Box(size):
            SubElement(geometry, "box", {"size": _numbers(size)})
        case Cylinder(radius, length):
            SubElement(geometry, "cylinder", {"radius": repr(radius), "length": repr(length)})
        case Sphere(radius):
            SubElement(geometry, "sphere", {"radius": repr(radius)})
        case _:
            SubElement(geometry, "mesh", {"filename": mesh})


def _show(link: Element, kind: str) -> None:
    """Copy the collision elements as visual elements, in the colour of a kind of body, if the link has none."""
    if link.find("visual") is not None:
        return
    for index, collision in enumerate(link.findall("collision")):
        visual = Element("visual")
        visual.extend(deepcopy(part) for part in collision if part.tag in _COPIED)
        SubElement(visual, "material", {"name": f"a465_{kind or 'other'}"})
        link.insert(index, visual)


def _origin(T: Array) -> Element:
    return Element("origin", {"xyz": _numbers(T[:3, 3]), "rpy": _numbers(rpy_of(T[:3, :3]))})


def rpy_of(R: Array) -> Array:
    """Return roll, pitch, yaw (3,) rad with R = Rz(yaw) Ry(pitch) Rx(roll); also exact at a pitch of 90 deg."""
    yaw = float(np.arctan2(R[1, 0], R[0, 0]))
    pitch = float(np.arctan2(-R[2, 0], np.hypot(R[0, 0], R[1, 0])))
    # the remaining rotation is about x, for any yaw chosen at a pitch of 90 deg
    remaining = (rot_z(yaw) @ rot_y(pitch)).T @ R
    return np.array([np.arctan2(remaining[2, 1], remaining[1, 1]), pitch, yaw])


def _numbers(values: Iterable[float]) -> str:
    return " ".join(repr(float(v) + 0.0) for v in values)


def stl_of(shape: Convex) -> bytes:
    """Return a hull as binary STL, m, in single precision."""
    points, faces = np.array(shape.points), hull_faces(shape)
    parts = [b"a465 hull".ljust(80), struct.pack("<I", len(faces.corners))]
    for normal, corners in zip(faces.normals, faces.corners, strict=True):
        parts.append(struct.pack("<12fH", *normal, *points[corners].ravel(), 0))
    return b"".join(parts)


def _disabled(there: Surroundings, links: Mapping[str, str]) -> dict[tuple[str, str], str]:
    """Pairs of links of which `plan.collision.world.World` checks no bodies, each with the reason."""
    world = World(there.robot, there.bodies, there.held, there.T_tool_held, there.allowed)
    checked = {frozenset(links[name] for name in world.pair_names(i)) for i in range(len(world.pairs))}
    written = ElementTree.fromstring(there.robot.srdf or "<robot/>")
    reasons = {
        frozenset((e.attrib["link1"], e.attrib["link2"])): e.attrib.get("reason", "")
        for e in written.iter("disable_collisions")
    }
    found: dict[tuple[str, str], str] = {}
    for a, b in combinations(world.names, 2):
        pair = links[a], links[b]
        if len({*pair}) == 1 or frozenset(pair) in checked or (pair[1], pair[0]) in found:
            continue
        joint = world.joint_of(a)
        reason = reasons.get(frozenset(pair), "")
        if not reason and joint == world.joint_of(b):
            reason = "move together" if joint else "both stand still"
        found[pair] = reason or "may touch"
    return found


def _semantics(
    there: Surroundings,
    disabled: Mapping[tuple[str, str], str],
    ends: tuple[str, str, str],
    hand: Mapping[str, str],
) -> Element:
    """Return the SRDF.

    Args:
        there: what is exported.
        disabled: pairs of links with reasons.
        ends: the links of the base, of the arm's end, and of the tool frame.
        hand: links beyond the arm's end, each with the joint before it.
    """
    base, end, tool = ends
    root, robot = Element("robot"), there.robot
    remarks = [
        f"{1e3 * padding:g} mm off every distance of {name!r}" for name, padding in there.paddings().items()
    ]
    if there.padding:
        remarks.insert(0, f"{1e3 * there.padding:g} mm off every distance; this file cannot")
    for remark in remarks:
        root.append(ElementTree.Comment(f" a465 takes {remark} ".replace("--", "- -")))
    arm = SubElement(root, "group", {"name": "arm"})
    SubElement(arm, "chain", {"base_link": base, "tip_link": tool})
    jaws = {name: at for name, at in robot.locked.items() if name in hand.values()}
    others = {name: at for name, at in robot.locked.items() if name not in jaws}
    for name, parts, joints in (("gripper", hand, jaws), ("locked", (), others)):
        if parts or joints:
            group = SubElement(root, "group", {"name": name})
            for link in parts:
                SubElement(group, "link", {"name": link})
            for joint in joints:
                SubElement(group, "joint", {"name": joint})
    if hand:
        SubElement(root, "end_effector", {"name": "hand", "parent_link": end, "group": "gripper"})
    for name, q in there.states.items():
        _state(root, name, "arm", dict(zip(robot.joint_names, q.tolist(), strict=True)))
    for name, group_name, at in (("jaws", "gripper", jaws), ("locked", "locked", others)):
        if at:
            _state(root, name, group_name, at)
    for (a, b), reason in disabled.items():
        SubElement(root, "disable_collisions", {"link1": a, "link2": b, "reason": reason})
    return root


def _state(root: Element, name: str, group: str, values: Mapping[str, float]) -> None:
    state = SubElement(root, "group_state", {"name": name, "group": group})
    for joint, value in values.items():
        SubElement(state, "joint", {"name": joint, "value": repr(float(value))})


def _text(root: Element) -> str:
    ElementTree.indent(root)
    return '<?xml version="1.0"?>\n' + ElementTree.tostring(root, encoding="unicode") + "\n"
