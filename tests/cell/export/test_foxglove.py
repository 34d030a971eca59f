"""The cell as Foxglove shows it: every body where the arm, the plan and the scene have it."""

from __future__ import annotations

from base64 import b64decode
from itertools import pairwise
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from arm.io.storage import data_file
from arm.robot.shapes import Body, Box, Capsule, Cylinder, Shape, Sphere, Torus, body_from_json, convex
from arm.se3 import Array, frozen, rotation, transform
from cell.config.cell_file import read_cell
from cell.export.foxglove import Image, _entity, image_message, messages_of_log, messages_of_plan
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


def test_a_log_shows_cubes_and_jaws_as_its_plan_and_its_samples_have_them(preview_case: PreviewCase) -> None:
    """Each motion of the plan began 10 s after the one before; the last two were not executed."""
    plan, unit, shipped = preview_case.plan, preview_case.unit, read_cell(data_file("scenes/cell.toml"))
    begins = [100.0 + 10.0 * number for number in range(len(plan.motions) - 2)]
    starts = [motion.path.start for motion in plan.motions]
    motions = [SimpleNamespace(start=start, begin_s=at) for start, at in zip(starts, begins, strict=False)]
    shut = shipped.gripper.fraction_closed(shipped.cube_size)
    q = np.tile(unit.positions(plan.start), (3, 1))
    samples = SimpleNamespace(time_s=np.array([95.0, 96.0, 97.0]), q=q, jaws=np.array([np.nan, 0.0, shut]))
    cell = SimpleNamespace(
        unit=unit,
        tool=shipped.tool,
        cube_size=shipped.cube_size,
        robot=lambda: preview_case.robot_open,
        robot_holding=lambda: preview_case.robot_holding,
    )
    made = messages_of_log(SimpleNamespace(motions=motions), samples, cell, [(98.0, plan)])  # type: ignore[arg-type]
    held = [next((m.held for m in motion.moves if m.held), None) for motion in plan.motions]
    shown: dict[str, list[tuple[float, str]]] = {}
    for time_ns, topic, value in sorted(made, key=lambda message: message[0]):
        for entity in value["entities"] if topic == "/scene" else ():
            if {"key": "kind", "value": "cube"} in entity["metadata"]:
                shown.setdefault(entity["id"], []).append((time_ns / 1e9, entity["frame_id"]))
    expected: dict[str, list[tuple[float, str]]] = {name: [(98.0, "base")] for name in shown}
    for (before, now), begin_s in zip(pairwise([None, *held]), begins, strict=False):
        if before is not None and now != before:
            expected[before].append((begin_s, "base"))
        if now is not None and now != before:
            expected[now].append((begin_s, "tool"))
    assert shown == expected
    assert sum(len(track) for track in shown.values()) >= 8
    ways = []
    for _, topic, value in made:
        if topic == "/tf":
            moved = [one["translation"] for one in value["transforms"] if one["child_frame_id"] in JAWS]
            ways.append(max(np.linalg.norm(list(way.values())) for way in moved))
    at = {body.name: body.T_joint_body[:3, 3] for body in preview_case.robot_open.bodies}
    then = {body.name: body.T_joint_body[:3, 3] for body in preview_case.robot_holding.bodies}
    assert ways == pytest.approx([0.0, 0.0, max(np.linalg.norm(then[n] - at[n]) for n in at)], abs=1e-5)


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
        if not entity["spheres"]:
            end = 0.5 * size["z"] + 5e-4  # outside, where distances are exact
            found += [T[:3, 3] + side * T[:3, 2] for side in (-end, end)]
        elif len(entity["cylinders"]) == 1:  # a capsule: its balls end it along its axis
            for ball in entity["spheres"]:
                middle = pose_of(*ball["pose"].values())[:3, 3]
                out = (middle - T[:3, 3]) / np.linalg.norm(middle - T[:3, 3])
                found.append(middle + 0.5 * ball["size"]["z"] * out)
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
