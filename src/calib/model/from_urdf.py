"""Build a chain with unknowns between two frames of a Pinocchio model."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import pinocchio as pin

from arm.errors import InputError
from arm.robot.description import joint_motion
from arm.se3 import frozen
from calib.model.chain import Chain, Element, Fixed, Motion, Unknown, joined


def chain_from_root(
    model: pin.Model,
    frame: str,
    reading_of: Mapping[str, int],
    unknowns_of: Callable[[str], tuple[Unknown, ...]] = lambda joint: (),
    after: Callable[[str], tuple[Element, ...]] = lambda joint: (),
) -> Chain:
    """Return T_root_frame as a chain.

    Args:
        model: of revolute and prismatic joints.
        frame: name of the frame at its end.
        reading_of: column of the readings for each joint between root and frame, by name.
        unknowns_of: returns the unknowns of a joint's own motion (offset, compliance, backlash) from its name.
        after: returns the elements to insert after a joint's motion, such as geometric errors, from its name.

    Raises:
        InputError: the frame does not exist, a joint on the chain has no reading or is of another kind.
    """
    if not model.existFrame(frame):
        names = ", ".join(f.name for f in model.frames)
        raise InputError(f"frame = {frame!r}: {model.name} has no such frame; it has {names}", frame=frame)
    end = model.frames[model.getFrameId(frame)]
    joints: list[int] = []
    joint = end.parentJoint
    while joint > 0:
        joints.insert(0, joint)
        joint = model.parents[joint]
    elements: list[Element] = []
    for joint in joints:
        name = model.names[joint]
        if name not in reading_of:
            raise InputError(f"joint {name}: on the chain to {frame}, but it has no reading", joint=name)
        kind, axis = joint_motion(model.joints[joint], name)
        elements += [
            Fixed(frozen(model.jointPlacements[joint].homogeneous)),
            Motion(axis, kind == "revolute", reading_of[name], unknowns_of(name)),
            *after(name),
        ]
    return joined([*elements, Fixed(frozen(end.placement.homogeneous))])
