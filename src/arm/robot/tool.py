"""Additions to a bare URDF: a tool, disabled collisions, padding, and acceleration limits; a tool without jaws."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from itertools import pairwise, product

import numpy as np
import numpy.typing as npt

from arm.arguments import number, rigid
from arm.controller.unit import Limits
from arm.errors import InputError
from arm.former import former_names
from arm.io.storage import data_file, read_text, sha256
from arm.numerics.products import mul
from arm.robot.description import joint_motion
from arm.robot.gripper import HAND, SHIPPED_URDF
from arm.robot.model import LinkBody, Robot, by_link, load_robot
from arm.robot.shapes import Body, shape_to_json
from arm.robot.urdf import bodies_of
from arm.se3 import Array, frozen

_ENDLESS = 'are these degrees? a joint that turns without end is type="continuous"'
# of a joint's range from 0, by the kind of the joint: two turns, and longer than the tracks of arms
_LIMIT = "<limit> of the URDF"
_MOST = {"revolute": (4.0 * np.pi, "rad", _ENDLESS), "prismatic": (100.0, "m", "is it in mm?")}


@dataclass(frozen=True, eq=False)
class FixedTool:
    """What the A465 carries on its flange instead of a gripper, and what never opens or closes: a ring, a pen.

    Attributes:
        T_flange_tool: the tool frame in the flange frame, 4x4, m.
        bodies: its bodies, with poses in the flange frame, not in the base.
    """

    T_flange_tool: Array
    bodies: tuple[Body, ...]

    def robot(self) -> Robot:
        """Return the A465 with this tool.

        Raises:
            InputError: a body has the name of one of the arm's.
        """
        urdf = data_file(SHIPPED_URDF)
        bare = load_robot(urdf, "flange", np.eye(4), text=_without_hand(read_text(urdf)))
        return with_tool(bare, self.T_flange_tool, self.bodies)

    def moved(self, T_flange_moved: Array) -> FixedTool:
        """Return it elsewhere on the flange: what was in the flange frame is in that of `T_flange_moved` (4x4)."""
        bodies = tuple(body.at(mul(T_flange_moved, body.T_base_body)) for body in self.bodies)
        return FixedTool(frozen(mul(T_flange_moved, self.T_flange_tool)), bodies)


def _without_hand(urdf: str) -> str:
    """Return the text of the arm's URDF without the links of the gripper and the joints that carry them."""
    root = ElementTree.fromstring(urdf)
    for part in list(root):
        child = part.find("child")
        if part.get("name") in HAND or (child is not None and child.get("link") in HAND):
            root.remove(part)
    return ElementTree.tostring(root, encoding="unicode")


def with_tool(robot: Robot, T_end_tool: npt.ArrayLike, bodies: Iterable[Body] = ()) -> Robot:
    """Return the arm with another tool frame and with the bodies of the tool.

    Args:
        robot: the arm.
        T_end_tool: the tool frame in the arm's end frame, 4x4, m.
        bodies: bodies of the tool, with poses in the END frame, not in the base. They are not checked against bodies
            on the same joint and on the joint before it.

    Raises:
        InputError: a body has the name of one of the arm's, or the frame is not a pose.
    """
    frame = rigid("T_end_tool", T_end_tool)
    joint, placement = robot.end_joint, robot.T_joint_end
    tool = tuple(
        LinkBody(b.name, joint, b.shape, frozen(mul(placement, b.T_base_body)), b.padding) for b in bodies
    )
    names = [b.name for b in (*robot.bodies, *tool)]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        why = f"tool: the arm already has a body named {twice[0]!r}; names must differ"
        raise InputError(why, names=twice)
    before = int(robot.model.parents[joint])
    carrying = [b.name for b in robot.bodies if b.joint == before]
    touching = {frozenset((b.name, name)) for b in tool for name in carrying}
    parts = [
        [b.name, shape_to_json(b.shape), b.T_joint_body.tolist(), *([b.padding] if b.padding else [])]
        for b in tool
    ]
    return replace(
        robot,
        T_end_tool=frame,
        bodies=(*robot.bodies, *tool),
        disabled_collisions=robot.disabled_collisions | touching,
        digest=sha256({"robot": robot.digest, "tool": frame.tolist(), "bodies": parts}),
    )


def padded(robot: Robot, padding: float, but: Iterable[str] = ()) -> Robot:
    """Return the arm with additional `padding`, m, on all bodies except those named in `but`.

    Raises:
        InputError: the padding is not from 0 to 0.5 m.
    """
    padding = number("padding", padding, 0.0, 0.5, "m")
    if padding == 0.0:
        return robot
    left = set(but)
    bodies = tuple(b if b.name in left else replace(b, padding=b.padding + padding) for b in robot.bodies)
    paddings = {b.name: b.padding for b in bodies if b.padding}
    return replace(robot, bodies=bodies, digest=sha256({"robot": robot.digest, "paddings": paddings}))


def with_disabled_collisions(
    robot: Robot, pairs: Iterable[Iterable[str]] = (), neighbours: bool = False
) -> Robot:
    """Return the arm with more disabled collisions between its bodies.

    Args:
        robot: the arm.
        pairs: pairs of names of links (for all their bodies) or of single bodies.
        neighbours: add all pairs of bodies on neighbouring joints, skipping joints without bodies. For arms without
            an SRDF, whose links overlap where they meet.

    Raises:
        InputError: a name is not one of the arm's.
    """
    named = {frozenset(pair) for pair in pairs}
    names = {b.name for b in robot.bodies}
    links = by_link(robot.bodies)
    unknown = sorted({name for pair in named for name in pair} - names - set(links))
    if unknown:
        why = f"pairs: {unknown[0]!r} is not a link or body; the arm has {', '.join(sorted(names))}"
        raise InputError(why, names=unknown)
    more = set(bodies_of(named, links))
    if neighbours:
        bearing = sorted({b.joint for b in robot.bodies})
        joints = set(pairwise(bearing))
        more |= {
            frozenset((a.name, b.name))
            for a, b in product(robot.bodies, repeat=2)
            if (a.joint, b.joint) in joints
        }
    touching = robot.disabled_collisions | more
    listed = sorted(sorted(pair) for pair in touching)
    return replace(
        robot, disabled_collisions=touching, digest=sha256({"robot": robot.digest, "touching": listed})
    )


def urdf_limits(
    robot: Robot,
    acceleration: float | npt.ArrayLike | Mapping[str, float],
    velocity: npt.ArrayLike | None = None,
    margin: float = 0.0,
) -> Limits:
    """Return the limits of the URDF with accelerations, which a URDF does not have.

    Args:
        robot: the arm.
        acceleration: one for all joints, one for each (n,), or by joint name; rad/s^2, m/s^2 for prismatic joints.
        velocity: (n,) instead of the URDF's, rad/s (m/s); or None.
        margin: subtracted from each end of the range, rad (m).

    Raises:
        InputError: a joint has no range, its range is in deg or mm, or a limit is not positive.
    """
    names = robot.joint_names
    if isinstance(acceleration, Mapping):
        missing = [name for name in names if name not in acceleration]
        if missing:
            others = [name for name in acceleration if name not in names]
            instead = f" ({', '.join(others)}: no joint that moves has this name)" if others else ""
            why = f"acceleration: joint {missing[0]!r} is missing; give one for every joint{instead}"
            raise InputError(why, names=missing)
        if unknown := [name for name in acceleration if name not in names]:
            why = f"acceleration: {unknown[0]!r} is no joint that moves; these are {', '.join(names)}"
            raise InputError(why, names=unknown)
        acceleration = [acceleration[name] for name in names]
    lower = np.array(robot.model.lowerPositionLimit, dtype=float) + margin
    upper = np.array(robot.model.upperPositionLimit, dtype=float) - margin
    fast = np.broadcast_to(
        np.asarray(robot.model.velocityLimit if velocity is None else velocity, dtype=float), lower.shape
    )
    push = np.broadcast_to(np.asarray(acceleration, dtype=float), lower.shape)
    joints = list(robot.model.joints)[1:]
    for name, joint, low, high, v, a in zip(names, joints, lower, upper, fast, push, strict=True):
        if not (low < high and np.isfinite(high - low)):
            why = f"joint {name}: range {low:g} to {high:g} must be finite and not empty ({_LIMIT}: lower, upper)"
            raise InputError(why, joint=name)
        most, unit, doubt = _MOST[joint_motion(joint, name)[0]]
        if max(-low, high) > most:
            why = f"joint {name}: range {low:g} to {high:g} must be within +-{most:.4g} {unit} ({doubt})"
            raise InputError(why, joint=name)
        if not (0.0 < v < np.inf and 0.0 < a < np.inf):
            if 0.0 < v < np.inf:
                raise InputError(f"joint {name}: acceleration {a:g} must be positive", joint=name)
            raise InputError(
                f"joint {name}: velocity {v:g} must be positive ({_LIMIT}: velocity)", joint=name
            )
    return Limits(frozen(lower), frozen(upper), frozen(fast), frozen(push))


former_names(__name__, __name__, ignoring="with_disabled_collisions")
