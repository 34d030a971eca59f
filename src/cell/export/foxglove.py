"""What Foxglove draws: the arm's frames over time, all bodies of the cell as primitives in them, and images.

Messages are JSON values of Foxglove's schemas FrameTransforms, SceneUpdate and CompressedImage (docs.foxglove.dev), and
of std_msgs/String for the arm's URDF. Frames: `base`, one for each joint, `tool`, and one for each body that the jaws
move.
"""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from arm.numerics.products import mul
from arm.plan_file import Plan
from arm.robot.gripper import Gripper
from arm.robot.model import Robot
from arm.robot.shapes import (
    Body,
    Box,
    Capsule,
    Convex,
    Cylinder,
    Shape,
    Sphere,
    body_from_json,
    hull_faces,
    simple_parts,
)
from arm.se3 import Array, transform
from cell.config.cell import Cell
from cell.export.plan import sampled, timed_steps
from cell.export.ros import NS, Message, nanoseconds
from cell.export.series import Executed
from cell.export.timeline import CubePose, cube_tracks
from cell.export.timeline import timed_steps as shown_steps
from cell.export.urdf import COLOURS
from driver.log.read import Session
from plan.program.stated_arm import StatedArm

BASE, TOOL = "base", "tool"
_DIGITS = 6  # decimals of lengths in m and of quaternions


@dataclass(frozen=True, eq=False)
class Motion:
    """Where the arm is at times.

    Attributes:
        time_s: (m,) s.
        q: (m, n) rad (m for sliding joints).
        closed: (m,) how far the jaws are closed: 0 as the open arm, 1 as the one that holds something.
    """

    time_s: Array
    q: Array
    closed: Array


@dataclass(frozen=True)
class Image:
    """An image of the camera: when it was taken, s, its format (png, jpeg), and the content of its file."""

    time_s: float
    format: str
    content: bytes


def messages_of_plan(plan: Plan, arm: StatedArm, period: float) -> list[Message]:
    """Return the messages that show a plan in its cell, unordered: the arm every `period` s, and at ends of segments.

    Raises:
        InputError: see `cell.export.plan.sampled`.
    """
    steps, shown = timed_steps(plan, arm.unit), shown_steps(plan)
    ends = [time for step in steps for time in (step.begin_s, step.end_s)]
    samples = sampled(plan, arm.unit, period)
    closed = np.interp(samples.time_s, ends, [jaws for step in shown for jaws in step.jaws])
    bodies = [body_from_json(body) for body in plan.scene.get("bodies", [])]
    cubes = [body_from_json(cube) for cube in plan.scene.get("cubes", [])]
    at = {there.start_s: step.begin_s for there, step in zip(shown, steps, strict=True)}
    tracks = cube_tracks(shown, cubes, arm.robot_open, arm.unit, plan.scene.get("supplies", ()))
    moved = [(at[pose.start_s], cube, pose) for cube in cubes for pose in tracks[cube.name]]
    return [
        *arm_messages(arm.robot_open, arm.robot_holding, Motion(samples.time_s, samples.q, closed), bodies),
        *map(_moved, moved),
    ]


def messages_of_log(
    session: Session, samples: Executed, cell: Cell, plans: Sequence[tuple[float, Plan]]
) -> list[Message]:
    """Return the messages that show what a log recorded, unordered: the arm, and each plan's bodies and cubes.

    Args:
        session: the log.
        samples: of its positions.
        cell: of the log.
        plans: in order, with the times at which they were noted, s.
    """
    closed = np.zeros(len(samples.time_s))
    if isinstance(cell.tool, Gripper) and cell.tool.opening > cell.cube_size:
        width = np.array([cell.tool.width(jaws) for jaws in np.nan_to_num(samples.jaws)])
        closed = np.clip((cell.tool.opening - width) / (cell.tool.opening - cell.cube_size), 0.0, 1.0)
    opened = cell.robot()
    found = arm_messages(opened, cell.robot_holding(), Motion(samples.time_s, samples.q, closed), ())
    ends_s = [*(time_s for time_s, _ in plans), np.inf][1:]
    for (begin_s, plan), end_s in zip(plans, ends_s, strict=True):
        bodies = [(BASE, body_from_json(body)) for body in plan.scene.get("bodies", [])]
        found.append((nanoseconds(begin_s), "/scene", _scene(begin_s, bodies)))
        shown, firsts = shown_steps(plan), {motion.path.start: motion.first for motion in plan.motions}
        at = {0.0: begin_s}
        for motion in session.motions:
            if begin_s <= motion.begin_s < end_s and motion.start in firsts:
                at.setdefault(shown[firsts[motion.start]].start_s, motion.begin_s)
        cubes = [body_from_json(cube) for cube in plan.scene.get("cubes", [])]
        tracks = cube_tracks(shown, cubes, opened, cell.unit, plan.scene.get("supplies", ()))
        moved = [(at[p.start_s], cube, p) for cube in cubes for p in tracks[cube.name] if p.start_s in at]
        found += map(_moved, moved)
    return found


def arm_messages(opened: Robot, holding: Robot, motion: Motion, bodies: Sequence[Body]) -> list[Message]:
    """Return the messages that show an arm's motion beside bodies that stand still, unordered.

    Args:
        opened, holding: the arm with open jaws, and with something in them.
        motion: of the arm.
        bodies: that stand still.
    """
    start_s = float(motion.time_s[0])
    placed = [*_links(opened, holding), *((BASE, body) for body in bodies)]
    found: list[Message] = [(nanoseconds(start_s), "/scene", _scene(start_s, placed))]
    if opened.urdf:
        found.append((nanoseconds(start_s), "/robot_description", {"data": opened.urdf}))
    for time_s, transforms in _transforms(opened, holding, motion):
        found.append((nanoseconds(time_s), "/tf", {"transforms": transforms}))
    return found


def image_message(image: Image) -> Message:
    """Return the message of an image."""
    value = {
        "timestamp": _time(image.time_s),
        "frame_id": "camera",
        "format": image.format,
        "data": b64encode(image.content).decode("ascii"),
    }
    return nanoseconds(image.time_s), "/images", value


def _moved(moved: tuple[float, Body, CubePose]) -> Message:
    time_s, cube, pose = moved
    placed = TOOL if pose.held else BASE, cube.at(pose.T)
    return nanoseconds(time_s), "/scene", _scene(time_s, [placed])


def _transforms(robot: Robot, holding: Robot, motion: Motion) -> Iterator[tuple[float, list[dict[str, Any]]]]:
    """Yield times and poses of frames: of each joint and the tool in the base, of moved jaws in their joint."""
    names, jaws = robot.joint_names, list(_jaws(robot, holding))
    for time_s, q, closed in zip(motion.time_s, motion.q, motion.closed, strict=True):
        poses = robot.joint_poses(q)
        placed = [(BASE, name, T) for name, T in zip(names, poses[1:], strict=True)]
        placed.append((BASE, TOOL, robot.T_base_tool(q)))
        placed += [(parent, name, transform(t=closed * by)) for parent, name, by in jaws]
        stamp = _time(float(time_s))
        yield float(time_s), [_frame(stamp, *one) for one in placed]


def _jaws(robot: Robot, holding: Robot) -> Iterator[tuple[str, str, Array]]:
    """Yield parent frame, name and way (3,) m, in the parent's axes, of each body that the jaws move as they close."""
    then = {body.name: body.T_joint_body[:3, 3] for body in holding.bodies}
    for body in robot.bodies:
        by = then[body.name] - body.T_joint_body[:3, 3]
        if np.abs(by).max() > 1e-9:
            yield _parent(robot, body.joint), body.name, by


def _parent(robot: Robot, joint: int) -> str:
    return robot.joint_names[joint - 1] if joint else BASE


def _links(robot: Robot, holding: Robot) -> Iterator[tuple[str, Body]]:
    """Yield the arm's bodies with their frames; those that the jaws move have frames of their own."""
    moved = {name for _, name, _ in _jaws(robot, holding)}
    for body in robot.bodies:
        yield (
            body.name if body.name in moved else _parent(robot, body.joint),
            Body(body.name, body.shape, body.T_joint_body, "robot"),
        )


def _scene(time_s: float, placed: Iterable[tuple[str, Body]]) -> dict[str, Any]:
    return {"deletions": [], "entities": [_entity(time_s, frame, body) for frame, body in placed]}


def _entity(time_s: float, frame: str, body: Body) -> dict[str, Any]:
    """A body as primitives that stay in a frame; it replaces what had its name before."""
    entity: dict[str, Any] = {
        "timestamp": _time(time_s),
        "frame_id": frame,
        "id": body.name,
        "lifetime": {"sec": 0, "nsec": 0},
        "frame_locked": True,
        "metadata": [{"key": "kind", "value": body.kind}],
    }
    entity |= {
        kind: []
        for kind in ("arrows", "cubes", "spheres", "cylinders", "lines", "triangles", "texts", "models")
    }
    red, green, blue, opacity = COLOURS.get(body.kind, COLOURS[""])
    colour = {"r": red, "g": green, "b": blue, "a": opacity}
    for part, T_body_part in simple_parts(body.shape):
        for kind, primitive in _primitives(part, mul(body.T_base_body, T_body_part)):
            entity[kind].append({**primitive, "color": colour})
    return entity


def _primitives(shape: Shape, T: Array) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield kind and value of the primitives that make up a shape at a pose T."""
    match shape:
        case Box():
            yield "cubes", {"pose": _pose(T), "size": _vector(shape.size)}
        case Sphere():
            yield "spheres", {"pose": _pose(T), "size": _vector([2.0 * shape.radius] * 3)}
        case Cylinder():
            yield "cylinders", _cylinder(T, shape.radius, shape.length)
        case Capsule():
            yield "cylinders", _cylinder(T, shape.radius, shape.length)
            for side in (-0.5, 0.5):
                at = mul(T, transform(t=(0.0, 0.0, side * shape.length)))
                yield from _primitives(Sphere(shape.radius), at)
        case Convex():
            yield (
                "triangles",
                {
                    "pose": _pose(T),
                    "points": [_vector(point) for point in shape.points],
                    "indices": hull_faces(shape).corners.ravel().tolist(),
                    "colors": [],
                },
            )


def _cylinder(T: Array, radius: float, length: float) -> dict[str, Any]:
    size = _vector([2.0 * radius, 2.0 * radius, length])
    return {"pose": _pose(T), "size": size, "bottom_scale": 1.0, "top_scale": 1.0}


def _frame(stamp: dict[str, int], parent: str, child: str, T: Array) -> dict[str, Any]:
    pose = _pose(T)
    return {
        "timestamp": stamp,
        "parent_frame_id": parent,
        "child_frame_id": child,
        "translation": pose["position"],
        "rotation": pose["orientation"],
    }


def _pose(T: Array) -> dict[str, Any]:
    x, y, z, w = np.round(Rotation.from_matrix(T[:3, :3]).as_quat(), _DIGITS).tolist()
    return {"position": _vector(T[:3, 3]), "orientation": {"x": x, "y": y, "z": z, "w": w}}


def _vector(values: Sequence[float] | Array) -> dict[str, float]:
    x, y, z = (np.round(np.asarray(values, dtype=float), _DIGITS) + 0.0).tolist()
    return {"x": x, "y": y, "z": z}


def _time(time_s: float) -> dict[str, int]:
    sec, nsec = divmod(nanoseconds(max(time_s, 0.0)), NS)
    return {"sec": sec, "nsec": nsec}
