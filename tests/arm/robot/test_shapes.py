"""Shapes as values: hulls, their faces, JSON there and back."""

from __future__ import annotations

import numpy as np
import pytest

from arm.errors import InputError
from arm.robot.shapes import (
    Body,
    Box,
    Capsule,
    Cylinder,
    Sphere,
    Torus,
    body_from_json,
    body_to_json,
    convex,
    hull_faces,
    simple_parts,
    thickness,
)
from arm.se3 import rotation, transform

CORNERS = [(x, y, z) for x in (0.0, 0.1) for y in (0.0, 0.2) for z in (0.0, 0.3)]


@pytest.mark.parametrize(
    "shape",
    [
        Box((0.1, 0.2, 0.3)),
        Cylinder(0.1, 0.2),
        Sphere(0.1),
        Capsule(0.1, 0.2),
        Torus(0.1, 0.02),
        convex(CORNERS),
    ],
)
def test_a_body_comes_back_from_json(shape) -> None:
    body = Body("thing", shape, transform(rotation((0.1, 0.2, 0.3)), (1.0, 2.0, 3.0)), "wall")
    back = body_from_json(body_to_json(body))
    assert back.shape == shape
    assert np.abs(back.T_base_body - body.T_base_body).max() < 1e-12


def test_only_a_torus_has_parts_which_are_along_its_circle() -> None:
    assert [shape for shape, _ in simple_parts(Capsule(0.1, 0.2))] == [Capsule(0.1, 0.2)]
    points = []
    for part, T in simple_parts(Torus(0.1, 0.02)):
        assert isinstance(part, Capsule)
        assert part.radius == 0.02
        along = np.array([[0.0, 0.0, share * part.length, 1.0] for share in (-0.5, 0.0, 0.5)])
        points.append((along @ T.T)[:, :3])
    assert np.concatenate(points)[:, 2] == pytest.approx(0.0, abs=1e-15)
    assert np.abs(np.linalg.norm(np.concatenate(points), axis=1) - 0.1).max() < 0.0026 * 0.1
    begins, ends = np.array(points)[:, 0], np.array(points)[:, 2]
    assert np.roll(begins, 1, axis=0) == pytest.approx(ends, abs=1e-12)


def test_a_hull_holds_all_its_points_and_is_its_own_hull_in_any_order() -> None:
    rng = np.random.default_rng(1)
    for _ in range(30):
        points = rng.normal(size=(60, 3)) * (0.1, 0.2, 0.05)
        shape = convex(points)
        assert convex(shape.points) == shape == convex(rng.permutation(np.repeat(points, 2, axis=0)))
        faces = hull_faces(shape)
        assert (points @ faces.normals.T - faces.offsets).max() < 1e-12


def test_faces_are_closed_and_seen_from_outside() -> None:
    rng = np.random.default_rng(2)
    for points in (np.array(CORNERS), rng.normal(size=(40, 3))):
        shape = convex(points)
        p, faces = np.array(shape.points), hull_faces(shape)
        a, b, c = (p[faces.corners[:, k]] for k in range(3))
        outwards = np.cross(b - a, c - a)
        assert np.all((outwards * faces.normals).sum(axis=1) > 0.0)
        volume = (a * outwards).sum() / 6.0  # divergence theorem
        assert volume == pytest.approx(0.006 if len(points) == 8 else volume)
        edges = [(f[i], f[(i + 1) % 3]) for f in faces.corners.tolist() for i in range(3)]
        assert len(set(edges)) == len(edges)
        assert {(j, i) for i, j in edges} == set(edges)  # each edge has a face on either side
        assert volume > 0.0


@pytest.mark.parametrize(
    ("points", "message"),
    [
        (np.zeros((3, 3)), "four or more points"),
        (np.full((5, 3), np.nan), "four or more points"),
        (np.zeros((10, 3)), "must not lie in one plane"),
        ([(x, y, 0.3 * x - y) for x in (0, 1, 2) for y in (0, 1, 2)], "must not lie in one plane"),
        (1e3 * np.array(CORNERS), "100 x 200 x 300 m; .* 0.0001 to 100 m"),
    ],
)
def test_points_that_span_no_body_are_refused(points, message: str) -> None:
    with pytest.raises(InputError, match=message):
        convex(points)


def test_thickness_is_across_the_plane_that_fits() -> None:
    rng = np.random.default_rng(3)
    flat = np.column_stack([rng.uniform(-1, 1, (200, 2)), rng.choice([-1e-3, 1e-3], 200)])
    assert thickness(flat @ rotation((0.4, 0.5, 0.6)).T + 7.0) == pytest.approx(2e-3, rel=0.2)
