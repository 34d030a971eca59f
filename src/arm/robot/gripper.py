"""A two-finger gripper on the A465's flange: its dimensions, and the arm's URDF with it.

From the flange outwards: a round body, the palm (a box), two fingers (boxes) that close along the tool's y axis. The
tool frame is between the finger tips. Links have the names of the shipped URDF, so its SRDF remains valid.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np

from arm.arguments import number
from arm.errors import InputError
from arm.io.storage import data_file, read_text
from arm.robot.model import Robot, load_a465
from arm.se3 import Array, transform

SHIPPED_URDF = "urdf/a465/a465.urdf"
LEAST_BODY = 1e-3  # m; a shorter round body is left out
SAME = 1e-9  # m, dimensions that differ by less count as equal
HAND = ("gripper", "palm", "finger_l", "finger_r")  # links of the gripper; all others are the arm's
LINKS = ("base", "turret", "upper_arm", "shoulder", "elbow", "forearm", "wrist", "hub")  # others with a body
Size = tuple[float, float, float]


@dataclass(frozen=True)
class Gripper:
    """Dimensions of a gripper, m; the defaults are those of the shipped one.

    Attributes:
        length: from the flange's face to the finger tips.
        opening: between the fingers' inner faces when open.
        shut: between the fingers' inner faces when fully closed.
        finger: size of one finger: across the closing direction, along it, and along the tool axis.
        palm: size of the box that carries the fingers, in the same directions.
        body_radius: radius of the round body between flange and palm.
        close_to: target opening when gripping; the jaws stop on the cube first.
        urdf: URDF of the arm with another kind of gripper, or None. It defines fingers and palm.

    Raises:
        InputError: a dimension is out of range, the parts are longer than the whole, or the jaws do not close.
    """

    length: float = 0.134112
    opening: float = 0.06
    shut: float = 0.0
    finger: Size = (0.02, 0.01, 0.0254)
    palm: Size = (0.05, 0.084, 0.030012)
    body_radius: float = 0.032
    close_to: float = 0.006
    urdf: Path | None = None

    def __post_init__(self) -> None:
        for name, low, high in (
            ("length", 1e-3, 1.0),
            ("opening", 1e-3, 0.3),
            ("shut", 0.0, 0.3),
            ("close_to", 0.0, 0.3),
            ("body_radius", 1e-3, 0.3),
        ):
            number(f"gripper: {name}", getattr(self, name), low, high, "m")
        if not self.shut <= self.close_to < self.opening:
            raise InputError(
                f"gripper: close_to = {1e3 * self.close_to:g} mm: must be from {1e3 * self.shut:g} mm, where the jaws "
                f"are shut, to less than {1e3 * self.opening:g} mm, where they are open",
                name="close_to",
            )
        if self.urdf is None and self.body_length < 0.0:
            raise InputError(
                f"gripper: length = {1e3 * self.length:g} mm: must be at least that of fingers and palm, "
                f"{1e3 * (self.finger[2] + self.palm[2]):g} mm",
                name="length",
            )

    def _measures(self) -> tuple[float, ...]:
        return (self.length, *self.finger, *self.palm, self.body_radius)

    @property
    def T_flange_tool(self) -> Array:
        """Pose of the tool frame, between the finger tips, in the flange frame."""
        return transform(t=(0.0, 0.0, self.length))

    @property
    def body_length(self) -> float:
        """Length of the round body between flange and palm, m."""
        return self.length - self.finger[2] - self.palm[2]

    def width(self, fraction_closed: float) -> float:
        """Return the opening, m, for 0 (open) to 1 (shut); linear in the stroke."""
        return self.opening - fraction_closed * (self.opening - self.shut)

    def fraction_closed(self, width: float) -> float:
        """Return 0 (open) to 1 (shut) for an opening, m."""
        return (self.opening - width) / (self.opening - self.shut)

    def robot(self, width: float) -> Robot:
        """Return the A465 with this gripper, its fingers `width` m apart.

        Raises:
            InputError: the fingers in the URDF do not end at `length`.
        """
        text = None if self.urdf is not None else self.description()
        return load_a465(self.length, width, self.urdf, text)

    def description(self) -> str:
        """Return the arm's URDF with this gripper; the unchanged file for the shipped one."""
        text = read_text(data_file(SHIPPED_URDF))
        if np.abs(np.subtract(self._measures(), Gripper()._measures())).max() < SAME:
            return text
        root = ElementTree.fromstring(text)
        long, (x, y, z), palm = self.body_length, self.finger, self.palm
        body = _named(root, "link", "gripper")
        collision = body.find("collision")
        if long < LEAST_BODY and collision is not None:
            body.remove(collision)
        else:
            _shape(body, "cylinder", (0.0, 0.0, long / 2.0), radius=self.body_radius, length=long)
        _origin(_named(root, "joint", "palm_mount"), (0.0, 0.0, max(long, 0.0) + palm[2] / 2.0))
        _shape(_named(root, "link", "palm"), "box", (0.0, 0.0, 0.0), size=palm)
        for jaw, finger, side in (("jaw_l", "finger_l", 1.0), ("jaw_r", "finger_r", -1.0)):
            joint = _named(root, "joint", jaw)
            _origin(joint, (0.0, 0.0, palm[2] / 2.0))
            limit = joint.find("limit")
            if limit is not None:
                limit.set("upper", repr(max(float(limit.get("upper", "0")), self.opening / 2.0)))
            _shape(_named(root, "link", finger), "box", (0.0, side * y / 2.0, z / 2.0), size=(x, y, z))
        return ElementTree.tostring(root, encoding="unicode")


def _named(root: Element, tag: str, name: str) -> Element:
    for element in root.findall(tag):
        if element.get("name") == name:
            return element
    raise InputError(f"{SHIPPED_URDF}: has no {tag} {name!r}", name=name)


def _origin(parent: Element, xyz: Sequence[float]) -> None:
    for old in parent.findall("origin"):
        parent.remove(old)
    parent.insert(0, Element("origin", {"xyz": " ".join(map(repr, xyz))}))


def _shape(link: Element, kind: str, xyz: Sequence[float], **measures: float | Sequence[float]) -> None:
    """Replace the collision bodies of a link with one at `xyz`."""
    for old in link.findall("collision"):
        link.remove(old)
    collision = ElementTree.SubElement(link, "collision")
    _origin(collision, xyz)
    geometry = ElementTree.SubElement(collision, "geometry")
    attributes = {
        key: repr(value) if isinstance(value, float) else " ".join(map(repr, value))
        for key, value in measures.items()
    }
    ElementTree.SubElement(geometry, kind, attributes)
