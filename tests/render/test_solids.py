"""Rays and solids: the lens undone, hits on the surface and nothing before them, windows that hide nothing."""

from __future__ import annotations

import numpy as np
import pytest

from arm.io.storage import data_file
from arm.robot.shapes import Body, Box, Capsule, Convex, Cylinder, Shape, Sphere, convex, hull_faces
from arm.se3 import Array, apply, inverse, rotation, transform
from render.first_hit import first_hits, in_view
from render.hulls import Hull
from render.light import Light
from render.rays import Bundle, pixel_rays, subpixel_rays
from render.solids import BodySolid
from render.window import Window
from vision.camera.model import Camera, read_camera


@pytest.fixture(scope="module")
def camera() -> Camera:
    return read_camera(data_file("scenes/cameras/lab.toml"))


@pytest.fixture(scope="module")
def small(camera: Camera) -> Camera:
    """The lab's view at an eighth of its resolution."""
    K = camera.K * np.array([[0.125], [0.125], [1.0]])
    return Camera(K, camera.distortion, (240, 150), camera.T_base_camera)


def signed_distance(shape: Shape, points: Array) -> Array:
    """Of points (..., 3) m of the body's frame to its surface, negative inside; of hulls at most that far."""
    match shape:
        case Capsule(radius, length):
            axis = np.clip(points[..., 2], -length / 2.0, length / 2.0)[..., None] * (0.0, 0.0, 1.0)
            return np.asarray(np.linalg.norm(points - axis, axis=-1) - radius)
        case Convex():
            faces = hull_faces(shape)
            return np.asarray((points @ faces.normals.T - faces.offsets).max(axis=-1))
        case Box(size):
            q = np.abs(points) - np.array(size) / 2.0
        case Cylinder(radius, length):
            radial = np.hypot(points[..., 0], points[..., 1]) - radius
            q = np.stack([radial, np.abs(points[..., 2]) - length / 2.0], axis=-1)
        case Sphere(radius):
            return np.asarray(np.linalg.norm(points, axis=-1) - radius)
    outside = np.linalg.norm(np.maximum(q, 0.0), axis=-1)
    return np.asarray(outside + np.minimum(q.max(axis=-1), 0.0))


def random_shape(rng: np.random.Generator) -> Shape:
    a, b, c = rng.uniform(0.02, 0.3, 3)
    hull = convex(rng.uniform(-0.5, 0.5, (12, 3)) * (a, b, c))
    shapes: tuple[Shape, ...] = (
        Box((a, b, c)),
        Cylinder(a / 2, b),
        Sphere(a / 2),
        Capsule(a / 2, b),
        hull,
    )
    return shapes[int(rng.integers(len(shapes)))]


SOLID_CUBE = convex([(x, y, z) for x in (-0.05, 0.05) for y in (-0.05, 0.05) for z in (-0.05, 0.05)])


def random_pose(rng: np.random.Generator, spread: float) -> Array:
    return transform(rotation(rng.normal(size=3)), (0.49, 0.0, 0.2) + rng.uniform(-spread, spread, 3))


def test_pixel_rays_project_back_to_their_pixels(camera: Camera) -> None:
    rays = pixel_rays(camera)
    points = np.stack([rays.x, rays.y, np.ones_like(rays.x)], axis=-1).astype(float)[::7, ::7]
    u, v = np.meshgrid(np.arange(0, 1920, 7), np.arange(0, 1200, 7))
    error = camera.project(points) - np.stack([u, v], axis=-1)
    assert np.abs(error).max() < 2e-4


def test_rays_inside_pixels_are_where_the_lens_puts_them(camera: Camera) -> None:
    rng = np.random.default_rng(0)
    row = np.append(rng.integers(0, 1200, 500), [0, 0, 1199, 1199])
    column = np.append(rng.integers(0, 1920, 500), [0, 1919, 0, 1919])
    moved = subpixel_rays(pixel_rays(camera), row, column).moved(0.46, -0.41)
    pixels = camera.project(np.stack([moved.x, moved.y, np.ones_like(moved.x)], axis=-1))
    assert np.abs(pixels - np.stack([column + 0.46, row - 0.41], axis=-1)).max() < 5e-4


@pytest.mark.parametrize("seed", range(18))
def test_a_hit_is_on_the_surface_and_nothing_is_before_it(seed: int, small: Camera) -> None:
    rng = np.random.default_rng(seed)
    body = Body("thing", random_shape(rng), random_pose(rng, 0.08), "cube")
    rays = pixel_rays(small)
    cast = BodySolid(body, Light()).cast(small.T_base_camera, rays)
    T_body_camera = inverse(body.T_base_body) @ small.T_base_camera
    direction = np.stack([rays.x, rays.y, np.ones_like(rays.x)], axis=-1).astype(float)
    met = np.isfinite(cast.depth)
    assert met.any()
    on_surface = apply(T_body_camera, direction[met] * cast.depth[met, None])
    assert np.abs(signed_distance(body.shape, on_surface)).max() < 2e-6
    for share in np.linspace(0.02, 0.999, 60):  # along each ray, up to its hit or to beyond the body
        depth = share * np.where(met, cast.depth, 3.0)
        before = signed_distance(body.shape, apply(T_body_camera, direction * depth[..., None]))
        assert before.min() > -2e-6


@pytest.mark.parametrize(
    "shape",
    [
        Box((0.1, 0.1, 0.1)),
        Cylinder(0.08, 0.1),
        Sphere(0.1),
        Capsule(0.05, 0.4),  # the camera between its balls
        Capsule(0.05, 0.02),  # the camera in one of them
        SOLID_CUBE,
    ],
)
def test_a_solid_that_holds_the_camera_or_is_behind_it_is_not_seen(shape: Shape, small: Camera) -> None:
    x, y, z = small.T_base_camera[:3, 3]
    for place in ((x + 0.01, y - 0.02, z + 0.015), (x + 0.01, y, z - 0.015), (x, y, z + 0.5)):
        solid = BodySolid(Body("thing", shape, transform(t=place), "wall"), Light())
        assert not np.isfinite(solid.cast(small.T_base_camera, pixel_rays(small)).depth).any()


def require_window_holds(solid: BodySolid, camera: Camera) -> None:
    rays = pixel_rays(camera)
    rows, columns = np.nonzero(np.isfinite(solid.cast(camera.T_base_camera, rays).depth))
    if len(rows):
        window = in_view([solid], camera.T_base_camera, rays)[0].window
        width, height = camera.size
        assert window.top <= max(rows.min() - 1, 0)
        assert window.bottom >= min(rows.max() + 2, height)
        assert window.left <= max(columns.min() - 1, 0)
        assert window.right >= min(columns.max() + 2, width)


@pytest.mark.parametrize("seed", range(40))
def test_windows_leave_out_no_pixel_nor_its_neighbours(seed: int, small: Camera) -> None:
    rng = np.random.default_rng(seed)
    spread = (0.3, 0.9, 1.5)[seed % 3]  # also beside the image
    require_window_holds(
        BodySolid(Body("thing", random_shape(rng), random_pose(rng, spread), "cube"), Light()), small
    )


@pytest.mark.parametrize(("dx", "dy"), [(-0.1, 0.0), (0.07, 0.05), (0.0, -0.2)])
def test_the_window_of_a_post_that_passes_the_camera(dx: float, dy: float, small: Camera) -> None:
    x, y, _ = small.T_base_camera[:3, 3]
    post = Body("post", Box((0.03, 0.03, 2.0)), transform(t=(x + dx, y + dy, 1.0)), "wall")
    require_window_holds(BodySolid(post, Light()), small)


def test_a_window_spares_most_of_the_image(camera: Camera) -> None:
    solid = BodySolid(Body("cube", Box((0.04,) * 3), transform(t=(0.46, 0.0, 0.02)), "cube"), Light())
    window = in_view([solid], camera.T_base_camera, pixel_rays(camera))[0].window
    assert (window.bottom - window.top) * (window.right - window.left) < 260**2  # the cube covers 170**2


def test_the_nearest_wins_whatever_the_order(small: Camera) -> None:
    rng = np.random.default_rng(5)
    bodies = [Body(f"b{i}", random_shape(rng), random_pose(rng, 0.15), "cube") for i in range(8)]
    solids = [BodySolid(b, Light()) for b in bodies]
    rays, T = pixel_rays(small), small.T_base_camera
    alone = np.min([s.cast(T, rays).depth for s in solids], axis=0)
    for order in (solids, solids[::-1]):
        hits = first_hits(in_view(order, T, rays), T, rays)
        assert np.array_equal(hits.depth, alone)


@pytest.mark.parametrize("seed", range(12))
def test_surfaces_are_lit_by_the_cosine_law(seed: int, small: Camera) -> None:
    rng = np.random.default_rng(seed)
    light = Light(lamp=(1.1, 0.7, 1.5), ambient=0.4)
    body = Body("thing", random_shape(rng), random_pose(rng, 0.03), "cube")
    rays = pixel_rays(small)
    cast = BodySolid(body, light).cast(small.T_base_camera, rays)
    met = np.isfinite(cast.depth)
    direction = np.stack([rays.x, rays.y, np.ones_like(rays.x)], axis=-1)[met].astype(float)
    points = apply(inverse(body.T_base_body) @ small.T_base_camera, direction * cast.depth[met, None])
    steps = 1e-4 * np.eye(3)
    gradient = [
        signed_distance(body.shape, points + d) - signed_distance(body.shape, points - d) for d in steps
    ]
    normals = np.stack(gradient, axis=-1) / 2e-4
    flat = 1e-6 if isinstance(body.shape, Convex) else 1e-4  # hulls have edges of a few degrees
    inside_a_face = np.abs(np.linalg.norm(normals, axis=-1) - 1.0) < flat  # not beside an edge
    towards = np.array(light.lamp) - body.T_base_body[:3, 3]
    cosine = normals @ body.T_base_body[:3, :3].T @ towards / np.linalg.norm(towards)
    expected = 205.0 * (0.4 + 0.6 * np.maximum(cosine, 0.0))
    assert np.count_nonzero(inside_a_face) > 100
    assert np.abs(cast.grey[met] - expected)[inside_a_face].max() < 0.3


def test_a_box_and_the_hull_of_its_corners_look_the_same(small: Camera) -> None:
    rng = np.random.default_rng(8)
    for _ in range(5):
        pose = random_pose(rng, 0.1)
        rays = pixel_rays(small)
        box, hull = (
            BodySolid(Body("thing", shape, pose, "cube"), Light()).cast(small.T_base_camera, rays)
            for shape in (Box((0.1, 0.1, 0.1)), SOLID_CUBE)
        )
        both = np.isfinite(box.depth)
        assert np.count_nonzero(both != np.isfinite(hull.depth)) <= 4  # rays along the outline
        both &= np.isfinite(hull.depth)
        assert np.abs(box.depth[both] - hull.depth[both]).max() < 2e-6
        assert np.count_nonzero(np.abs(box.grey[both] - hull.grey[both]) > 0.01) <= 4  # rays along an edge


def test_a_ray_along_a_face_meets_a_hull_only_if_it_is_not_above_it() -> None:
    hull = Hull(SOLID_CUBE)
    ones, zeros = np.ones(1, dtype=np.float32), np.zeros(1, dtype=np.float32)
    for height, met in ((0.049, True), (0.051, False), (-0.051, False)):
        bundle = Bundle(np.array([-1.0, 0.0, height]), ones, zeros, zeros)
        depth, face = hull.enter(bundle, 1e-7)
        assert np.isfinite(depth[0]) == met
        if met:
            assert depth[0] == pytest.approx(0.95)
            assert hull.normals[face[0]] == pytest.approx([-1.0, 0.0, 0.0])


def test_window_area_indexes_an_image() -> None:
    image = np.arange(12).reshape(3, 4)
    assert image[Window(1, 3, 2, 4).area].tolist() == [[6, 7], [10, 11]]
