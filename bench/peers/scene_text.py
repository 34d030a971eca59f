"""An arm and the bodies around it as one URDF, and what may touch as an SRDF: what other checkers read."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Iterable, Sequence

from arm.robot.shapes import Body, Box, Capsule, Cylinder, Shape, Sphere
from cell.export.urdf import rpy_of


def scene_urdf(arm: str, bodies: Sequence[Body], welded: dict[str, float] | None = None) -> str:
    """Return the URDF of an arm with bodies as links that are fixed to its first link.

    Args:
        arm: URDF, whose first link is in the base frame.
        bodies: names have no meaning for it but to be told apart.
        welded: joints that are fixed, and where, rad; only joints about an axis of the frame before it.
    """
    root = ElementTree.fromstring(arm)
    base = root.findall("link")[0].attrib["name"]
    for joint in root.findall("joint"):
        at = (welded or {}).get(joint.attrib["name"])
        if at is not None:
            _weld(root, joint, at)
    for body in bodies:
        link = ElementTree.SubElement(root, "link", {"name": body.name})
        collision = ElementTree.SubElement(link, "collision")
        ElementTree.SubElement(collision, "geometry").append(_element(body.shape))
        joint = ElementTree.SubElement(root, "joint", {"name": f"to {body.name}", "type": "fixed"})
        ElementTree.SubElement(joint, "parent", {"link": base})
        ElementTree.SubElement(joint, "child", {"link": body.name})
        T = body.T_base_body
        pose = {"xyz": _numbers(T[:3, 3]), "rpy": _numbers(rpy_of(T[:3, :3]))}
        ElementTree.SubElement(joint, "origin", pose)
    return ElementTree.tostring(root, encoding="unicode")


def scene_srdf(links: Sequence[str], allowed: Iterable[frozenset[str]], plugins: str) -> str:
    """Return an SRDF with one group, pairs that are not checked, and the file of contact managers."""
    pairs = "".join(
        f'<disable_collisions link1="{a}" link2="{b}" reason="Allowed"/>' for a, b in map(sorted, allowed)
    )
    return (
        f'<robot name="made_up" version="1.0.0"><group name="arm"><chain base_link="{links[0]}" '
        f'tip_link="{links[-1]}"/></group><contact_managers_plugin_config filename="file://{plugins}"/>{pairs}</robot>'
    )


def _weld(root: ElementTree.Element, joint: ElementTree.Element, at: float) -> None:
    """Replace a joint by a fixed one to a link of no shape, which stands rotated on the child's frame."""
    child, origin, axis = joint.find("child"), joint.find("origin"), joint.find("axis")
    if child is None or origin is None or axis is None:
        raise ValueError(f"joint {joint.attrib['name']} has no child, origin or axis")
    name = f"before {child.attrib['link']}"
    ElementTree.SubElement(root, "link", {"name": name})
    turn = " ".join(f"{float(x) * at:.17g}" for x in axis.attrib["xyz"].split())
    second = ElementTree.SubElement(root, "joint", {"name": f"weld {name}", "type": "fixed"})
    ElementTree.SubElement(second, "parent", {"link": name})
    ElementTree.SubElement(second, "child", {"link": child.attrib["link"]})
    ElementTree.SubElement(second, "origin", {"xyz": "0 0 0", "rpy": turn})
    joint.set("type", "fixed")
    child.set("link", name)


def _element(shape: Shape) -> ElementTree.Element:
    match shape:
        case Box(size):
            return ElementTree.Element("box", {"size": _numbers(size)})
        case Cylinder(radius, length):
            return ElementTree.Element("cylinder", {"radius": f"{radius:.17g}", "length": f"{length:.17g}"})
        case Capsule(radius, length):
            return ElementTree.Element("capsule", {"radius": f"{radius:.17g}", "length": f"{length:.17g}"})
        case Sphere(radius):
            return ElementTree.Element("sphere", {"radius": f"{radius:.17g}"})
    raise ValueError(f"{type(shape).__name__}: no element of URDF is used for it here")


def _numbers(values: Iterable[float]) -> str:
    return " ".join(f"{v:.17g}" for v in values)
