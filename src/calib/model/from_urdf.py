"""Build a chain with unknowns between two frames of a Pinocchio model."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
import pinocchio as pin

from arm.errors import InputError
from arm.se3 import Array, frozen
from calib.model.chain import Chain, Element, Fixed, Motion, Unknown, joined

_AXES = {"X": (1.0, 0.0, 0.0), "Y": (0.0, 1.0, 0.0), "Z": (0.0, 0.0, 1.0)}


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
        axis, turns = _axis(model.joints[joint], name)
        elements += [
            Fixed(frozen(model.jointPlacements[joint].homogeneous)),
            Motion(axis, turns, reading_of[name], unknowns_of(name)),
            *after(name),
        ]
    return joined([*elements, Fixed(frozen(end.placement.homogeneous))])


def _axis(joint: pin.JointModel, name: str) -> tuple[Array, bool]:
    """Return a joint's axis, and whether it is a rotation."""
    kind = joint.shortname()
    turns = kind.startswith("JointModelR")
    if kind in {"JointModelRevoluteUnaligned", "JointModelPrismaticUnaligned"}:
        return frozen(np.asarray(joint.extract().axis)), turns
    if kind[:-1] in {"JointModelR", "JointModelP"} and kind[-1] in _AXES:
        return frozen(_AXES[kind[-1]]), turns
    raise InputError(
        f"joint {name}: is a {kind}; chains support revolute and prismatic joints only", joint=name, kind=kind
    )
