"""The cell as Foxglove shows it: every body where the arm, the plan and the scene have it."""

from __future__ import annotations

from base64 import b64decode
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from arm.robot.shapes import Body, Box, Capsule, Cylinder, Shape, Sphere, Torus, body_from_json, convex
from arm.se3 import Array, frozen, rotation, transform
from cell.export.foxglove import Image, _entity, image_message, messages_of_plan
from cell.export.plan import sampled
from pages.preview import PreviewCase
from plan.collision.world import distance_of
from plan.program.stated_arm import StatedArm

PERIOD = 0.2
Topics = dict[str, list[tuple[int, Any]]]


@pytest.fixture(scope="module")
def topics(preview_case: PreviewCase) -> Topics:
    """Messages of a plan of four cubes, by topic, in order."""
    case, limits = preview_case, preview_case.unit.limits()
    arm = StatedArm(case.robot_open, case.robot_holding, case.unit, limits)
    found: Topics = {}
    for time_ns, topic, value in sorted(messages_of_plan(case.plan, arm, PERIOD), key=lambda m: m[0]):
        found.setdefault(topic, []).append((time_ns, value))
    return found


def pose_of(position: dict[str, float], orientation: dict[str, float]) -> Array:
    q = [orientation[axis] for axis in "xyzw"]
    return transform(Rotation.from_quat(q).as_matrix(), [position[axis] for axis in "xyz"])


def frames_of(message: dict[str, Any]) -> dict[str, Array]:
    """Poses of all frames in the base."""
    found = {"base": np.eye(4)}
    for one in message["transforms"]:
        T = pose_of(one["translation"], one["rotation"])
        found[one["child_frame_id"]] = found[one["parent_frame_id"]] @ T
    return found


def test_every_body_of_the_arm_is_where_the_arm_has_it(preview_case: PreviewCase, topics: Topics) -> None:
    robot = preview_case.robot_open
    samples = sampled(preview_case.plan, preview_case.unit, PERIOD)
    entities = {e["id"]: e for e in topics["/scene"][0][1]["entities"]}
    assert len(topics["/tf"]) == len(samples.time_s)
    for (time_ns, message), time_s, q in zip(topics["/tf"], samples.time_s, samples.q, strict=True):
        assert time_ns == pytest.approx(1e9 * time_s, abs=1e3)
        frames = frames_of(message)
        np.testing.assert_allclose(frames["tool"], robot.T_base_tool(q), atol=3e-6)
        for body in robot.bodies_at(q):
            if body.name not in JAWS:
                assert_drawn(body, entities[body.name], frames)
    placed = {body["name"]: body_from_json(body) for body in preview_case.plan.scene["bodies"]}
    assert set(placed) | {body.name for body in robot.bodies} <= set(entities)
    for name, body in placed.items():
        assert_drawn(body, entities[name], {"base": np.eye(4)})


JAWS = ("jaw_l", "jaw_r", "finger_l", "finger_r")


def assert_drawn(body: Body, entity: dict[str, Any], frames: dict[str, Array]) -> None:
    """The middle of the entity's primitives is at the body's pose, and their axes are the body's."""
    drawn = [p for kind in ("cubes", "cylinders", "spheres", "triangles") for p in entity[kind]]
    T = frames[entity["frame_id"]] @ pose_of(*drawn[0]["pose"].values())
    assert drawn
    np.testing.assert_allclose(T, body.T_base_body, atol=1e-5)


def test_a_cube_is_where_it_stands_until_it_moves_with_the_tool(topics: Topics) -> None:
    tracks: dict[str, list[tuple[int, dict[str, Any]]]] = {}
    for time_ns, message in topics["/scene"]:
        for entity in message["entities"]:
            if {"key": "kind", "value": "cube"} in entity["metadata"]:
                tracks.setdefault(entity["id"], []).append((time_ns, entity))
    assert len(tracks) == 4
    times, frames = np.array([t for t, _ in topics["/tf"]]), [frames_of(m) for _, m in topics["/tf"]]
    for track in tracks.values():
        assert [entity["frame_id"] for _, entity in track] == ["base", "tool", "base"]
        for (_, before), (time_ns, after) in pairwise(track):
            there = frames[int(np.argmin(np.abs(times - time_ns)))]
            one, two = (
                there[e["frame_id"]] @ pose_of(*e["cubes"][0]["pose"].values()) for e in (before, after)
            )
            np.testing.assert_allclose(one, two, atol=1e-4)
        assert np.linalg.norm(two[:3, 3] - pose_of(*track[0][1]["cubes"][0]["pose"].values())[:3, 3]) > 0.05


def test_the_jaws_close_as_they_grip_and_open_again(preview_case: PreviewCase, topics: Topics) -> None:
    opened, holding = (
        {body.name: body.T_joint_body for body in robot.bodies}
        for robot in (preview_case.robot_open, preview_case.robot_holding)
    )
    ways = {name: np.linalg.norm(holding[name][:3, 3] - opened[name][:3, 3]) for name in opened}
    moved = {name for name, way in ways.items() if way > 1e-9}
    assert moved
    for name in moved:
        off = [
            np.linalg.norm([one["translation"][axis] for axis in "xyz"])
            for _, message in topics["/tf"]
            for one in message["transforms"]
            if one["child_frame_id"] == name
        ]
        assert (off[0], off[-1]) == (0.0, 0.0)
        assert max(off) == pytest.approx(ways[name], abs=2e-6)


@pytest.mark.parametrize("seed", range(12))
def test_primitives_have_the_surface_of_the_shape(seed: int) -> None:
    rng = np.random.default_rng(seed)
    shapes: list[Shape] = [
        Box((0.05, 0.2, 0.1)),
        Sphere(0.05),
        Cylinder(0.03, 0.2),
        Capsule(0.03, 0.2),
        Torus(0.1, 0.02),
        convex(rng.uniform(-0.1, 0.1, (12, 3))),
    ]
    T = transform(rotation(rng.normal(size=3)), rng.uniform(-0.3, 0.3, 3))
    body = Body("b", shapes[seed % 6], frozen(T), "wall")
    points = _surface(_entity(0.0, "base", body), rng)
    assert len(points) >= 4
    for point in points:
        ball = Body("ball", Sphere(1e-4), transform(t=point), "wall")
        assert abs(distance_of(body, ball).value) < 1e-3


def _surface(entity: dict[str, Any], rng: np.random.Generator) -> list[Array]:
    """Points on the primitives of a body that are on its surface: corners, and where an axis leaves."""
    found = []
    for cube in entity["cubes"]:
        T, size = pose_of(*cube["pose"].values()), np.array(list(cube["size"].values()))
        found += [T[:3, :3] @ (0.5 * size * rng.choice([-1, 1], 3)) + T[:3, 3] for _ in range(8)]
    for ball in [] if entity["cylinders"] else entity["spheres"]:
        T, radius = pose_of(*ball["pose"].values()), 0.5 * ball["size"]["x"]
        directions = rng.normal(size=(8, 3))
        found += [T[:3, 3] + radius * d / np.linalg.norm(d) for d in directions]
    for rod in entity["cylinders"]:
        T, size = pose_of(*rod["pose"].values()), rod["size"]
        for angle in rng.uniform(-np.pi, np.pi, 4):
            at = [0.5 * size["x"] * np.cos(angle), 0.5 * size["y"] * np.sin(angle), 0.0]
            found.append(T[:3, :3] @ at + T[:3, 3])
    for hull in entity["triangles"]:
        T = pose_of(*hull["pose"].values())
        found += [T[:3, :3] @ list(hull["points"][i].values()) + T[:3, 3] for i in set(hull["indices"])]
    return found


def test_an_image_comes_back() -> None:
    time_ns, topic, value = image_message(Image(1.5, "png", b"content"))
    assert (time_ns, topic, value["format"]) == (1_500_000_000, "/images", "png")
    assert b64decode(value["data"]) == b"content"
    assert value["timestamp"] == {"sec": 1, "nsec": 500_000_000}
