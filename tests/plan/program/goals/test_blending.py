"""Corners of the tool's way that may be cut."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from arm.controller.unit import Unit
from arm.robot.model import Robot
from arm.se3 import Array, transform
from plan.cartesian.line import Line
from plan.program.goals.blending import blend_distance
from plan.program.goals.linear_move import LinearMove
from plan.program.goals.target import Target
from plan.program.pose_lists import plan_poses
from tasks.pose_lists import EFFORT, FAST, TABLE, check_plan, down


def test_where_the_tool_turns_back_there_is_no_corner_to_cut(robot: Robot, crs97: Unit) -> None:
    target = Target("a", down(0.45, -0.2, 0.1), free="rz", approach=0.03, retract=0.03, blend_radius=0.01)
    plan = plan_poses(
        robot,
        [TABLE],
        [target],
        np.radians([-35, -35, -85, 0, -60, 0]),
        crs97.limits(),
        options=FAST,
        effort=EFFORT,
    )
    check_plan(plan, [target], crs97.limits())
    tips = np.stack([robot.T_base_tool(q)[:3, 3] for q in plan.sample(0.01)[1]])
    assert np.linalg.norm(tips - target.T_base_tool[:3, 3], axis=1).min() < 2e-4


def line_of(role: str, target: int, start: Array, end: Array) -> LinearMove:
    """A line of the tool, without its path."""
    line = Line(transform(t=start), transform(t=end))
    return LinearMove(line, None, 0.1, role=role, target=target)  # type: ignore[arg-type]


def corner(
    before: str, after: str, angle: float, lengths: tuple[float, float]
) -> tuple[LinearMove, LinearMove]:
    """Two lines in a plane, the second turned by `angle`; an approach and its target are the second one's."""
    at = np.array([0.4, 0.0, 0.2])
    start = at - lengths[0] * np.array([1.0, 0.0, 0.0])
    end = at + lengths[1] * np.array([np.cos(angle), np.sin(angle), 0.0])
    return line_of(before, 0, start, at), line_of(after, 1, at, end)


BLENDED = Target("a", np.eye(4), blend_radius=0.003)


@pytest.mark.parametrize("seed", range(20))
def test_a_blend_passes_its_corner_as_near_as_allowed_and_leaves_most_of_its_lines(seed: int) -> None:
    rng = np.random.default_rng(seed)
    angle, lengths = rng.uniform(0.0, 2.9), tuple(rng.uniform(0.005, 0.1, 2))
    cut = blend_distance(*corner("line", "line", angle, lengths), [BLENDED, BLENDED])
    assert 0.0 < cut <= 0.4 * min(lengths) + 1e-12
    passed = cut * np.sin(angle / 2.0)  # distance of the middle of the straight move across
    assert passed <= BLENDED.blend_radius + 1e-12
    if cut < 0.39 * min(lengths) and angle > 0.2:
        assert passed == pytest.approx(BLENDED.blend_radius)


@pytest.mark.parametrize(
    ("before", "after", "first", "second", "blended"),
    [
        ("line", "line", {}, {}, True),
        ("line", "line", {"blend_radius": 0.0}, {}, False),
        ("line", "line", {}, {"blend_radius": 0.0}, True),  # the corner is the first one's
        ("line", "line", {"dwell_s": 0.1}, {}, False),
        ("line", "line", {}, {"dwell_s": 0.1}, True),
        ("line", "retract", {"jaws": 0.0}, {}, False),
        ("line", "approach", {"dwell_s": 0.1}, {}, True),  # the far end of an approach: nothing is done there
        ("retract", "line", {"jaws": 0.0}, {}, True),  # the far end of a retract
        ("line", "line", {"allowed_collisions": [("a", "b")]}, {}, False),
        ("line", "line", {}, {"allowed_collisions": [("a", "b")]}, False),
        ("line", "line", {"allowed_collisions": [("a", "b")]}, {"allowed_collisions": [("b", "a")]}, True),
    ],
)
def test_a_corner_is_blended_only_where_nothing_is_done_and_the_same_may_touch(
    before: str, after: str, first: dict[str, Any], second: dict[str, Any], blended: bool
) -> None:
    targets = [replace(BLENDED, **first), replace(BLENDED, name="b", **second)]
    cut = blend_distance(*corner(before, after, 1.0, (0.1, 0.1)), targets)
    assert (cut > 0.0) == blended


@pytest.mark.parametrize(
    ("angle", "blended"), [(0.0, True), (1.5, True), (2.9, True), (3.0, False), (np.pi, False)]
)
def test_where_the_tool_turns_back_nothing_is_cut(angle: float, blended: bool) -> None:
    assert (blend_distance(*corner("line", "line", angle, (0.1, 0.1)), [BLENDED, BLENDED]) > 0.0) == blended
