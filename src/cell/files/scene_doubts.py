"""Doubts about a scene file: values that its rules allow, and that are rather meant in another unit or frame."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from arm.numerics.products import norm
from arm.robot.shapes import Box
from cell.config.doubts.angles import doubt_of_deg
from cell.config.doubts.cell_doubts import around_base
from cell.files.scene import SceneFile

_HELD_WITHIN = 0.1  # m from the finger tips to the middle of a cube between them
_IN_CUBE, _OFF_CUBE = 1.5e-3, 0.03  # m by which jaws may be narrower or wider than what they hold


def scene_doubts(scene: SceneFile) -> tuple[str, ...]:
    """Say which values of a scene are rather meant otherwise, each with its key."""
    return (*_angles(scene), *_held(scene), *around_base(scene.robot, scene.bodies, "bodies").values())


def _angles(scene: SceneFile) -> Iterator[str]:
    """Say which configurations may be in rad, and which motions are none."""
    for key, questions, names in (
        ("queries", scene.queries, ("q_deg",)),
        ("motions", scene.motions, ("from_deg", "to_deg")),
    ):
        for number, one in enumerate(questions):
            for name, q in zip(names, one.q, strict=True):
                if doubt := doubt_of_deg(q, scene.unit):
                    yield f"{key}[{number}] ({one.name}): {name} = {doubt}"
            if len(names) > 1 and np.array_equal(one.q[0], one.q[1]):
                yield f"{key}[{number}] ({one.name}): from_deg and to_deg are the same: nothing moves"


def _held(scene: SceneFile) -> Iterator[str]:
    """Say that what is held is not between the jaws."""
    if scene.held is None or not isinstance(scene.held.shape, Box):
        return
    centre, R = scene.T_tool_held[:3, 3], scene.T_tool_held[:3, :3]
    if norm(centre) > _HELD_WITHIN:
        shown = ", ".join(f"{1e3 * v:g}" for v in centre)
        yield (
            f"held.centre_mm = [{shown}]: is {1e3 * norm(centre):.0f} mm from the finger tips: is it in the base "
            "frame? It is in the tool frame, in which what is between the fingers is near 0, 0, 0"
        )
        return
    width = float(
        (np.abs(R[1]) * scene.held.shape.size).sum()
    )  # along y of the tool, in which the jaws travel
    apart = scene.jaw_opening - width
    if apart < -_IN_CUBE:
        where = "the fingers are inside it, and fingers and what they hold are not checked"
    elif apart > _OFF_CUBE:
        where = "the fingers do not touch it"
    else:
        return
    yield (
        f"jaw_opening_mm = {1e3 * scene.jaw_opening:g}: what is held is {1e3 * width:.4g} mm wide: {where}"
    )
