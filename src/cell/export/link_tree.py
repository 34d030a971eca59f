"""The tree of links in an arm's URDF: its base, the arm's end, and what hangs on that."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from xml.etree.ElementTree import Element

from arm.errors import InputError
from arm.robot.model import Robot


def urdf_root(robot: Robot) -> Element:
    """Return the URDF of an arm.

    Raises:
        InputError: there is none that describes it, or it is not XML.
    """
    if not robot.urdf:
        raise InputError("the arm is calibrated, so no URDF describes it", name="urdf")
    try:
        return ElementTree.fromstring(robot.urdf)
    except ElementTree.ParseError as error:
        raise InputError(f"the arm's URDF is not XML: {error}", name="urdf") from error


def _link(joint: Element, side: str) -> str:
    """The link on a side of a joint, ``parent`` or ``child``."""
    found = joint.find(side)
    if found is None:
        raise InputError(f"the arm's URDF: joint {joint.get('name')} has no {side}", joint=joint.get("name"))
    return str(found.get("link"))


def base_link(root: Element) -> str:
    """Return the link that no joint moves.

    Raises:
        InputError: there is none.
    """
    children = {_link(joint, "child") for joint in root.iterfind("joint")}
    links = (str(link.get("name")) for link in root.iterfind("link"))
    base = next((name for name in links if name not in children), None)
    if base is None:
        raise InputError("the arm's URDF has no link that stands still", name="urdf")
    return base


def end_link(root: Element, robot: Robot) -> str:
    """Return the link of an arm's end frame, which may also be named after the joint before it."""
    joint = root.find(f"joint[@name='{robot.end_frame}']")
    is_link = root.find(f"link[@name='{robot.end_frame}']") is not None
    return robot.end_frame if is_link or joint is None else _link(joint, "child")


def links_beyond(root: Element, link: str) -> dict[str, str]:
    """Return the links that hang on a link in the order of the file, each with the joint before it."""
    found: dict[str, str] = {}
    hanging = [link]
    for parent in hanging:  # grows
        for joint in root.iterfind("joint"):
            child = _link(joint, "child")
            if _link(joint, "parent") == parent and child not in found:
                found[child] = str(joint.get("name"))
                hanging.append(child)
    names = (str(element.get("name")) for element in root.iterfind("link"))
    return {name: found[name] for name in names if name in found}
