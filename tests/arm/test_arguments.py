"""What a caller gives: shapes, poses, limits. Whatever is wrong is refused in a sentence that names it."""

from __future__ import annotations

import re

import numpy as np
import pytest

from arm.arguments import RIGID, joints, option_numbers, pairs, poses, rigid
from arm.controller.unit import Limits
from arm.errors import InputError
from arm.robot.shapes import Body, Box, Capsule, Convex, Cylinder, Sphere, Torus, body_to_json
from arm.se3 import rotation, transform

NAN, INF = float("nan"), float("inf")
TETRAHEDRON = ((0.0, 0.0, 0.0), (0.1, 0.0, 0.0), (0.0, 0.1, 0.0), (0.0, 0.0, 0.1))
SQUARE = ((0.0, 0.0, 0.0), (0.1, 0.0, 0.0), (0.0, 0.1, 0.0), (0.1, 0.1, 0.0))


@pytest.mark.parametrize("wrong", [-0.1, 0.0, NAN, INF, "0.1", None, True, 1e9, [0.1]])
def test_every_size_of_every_shape_is_a_positive_length(wrong) -> None:  # type: ignore[no-untyped-def]
    for name, make in (
        (r"Box\.size\[0\]", lambda: Box((wrong, 0.1, 0.1))),
        (r"Box\.size\[1\]", lambda: Box((0.1, wrong, 0.1))),
        (r"Box\.size\[2\]", lambda: Box((0.1, 0.1, wrong))),
        (r"Sphere\.radius", lambda: Sphere(wrong)),
        (r"Cylinder\.radius", lambda: Cylinder(wrong, 0.1)),
        (r"Cylinder\.length", lambda: Cylinder(0.1, wrong)),
        (r"Capsule\.radius", lambda: Capsule(wrong, 0.1)),
        (r"Capsule\.length", lambda: Capsule(0.1, wrong)),
        (r"Torus\.radius", lambda: Torus(wrong, 0.1)),
        (r"Torus\.tube", lambda: Torus(0.1, wrong)),
    ):
        with pytest.raises(InputError, match=name + r" = .*: must be .*from 1e-06 to 10000.*metres"):
            make()


@pytest.mark.parametrize("wrong", ["box", 0.1, None, (0.1, 0.1), (0.1, 0.1, 0.1, 0.1), np.zeros((3, 3))])
def test_a_box_has_three_edges(wrong) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(InputError, match=r"Box\.size"):
        Box(wrong)


@pytest.mark.parametrize(
    ("points", "message"),
    [
        (SQUARE, "must not lie in one plane"),
        (TETRAHEDRON[:3], "four or more points"),
        ((*TETRAHEDRON, (NAN, 0.0, 0.0)), "finite"),
        (((0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0)), "x, y, z"),
        ("points", "'points'"),
        (None, "None"),
    ],
)
def test_a_hull_has_a_volume(points, message: str) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(InputError, match=r"Convex\.points.*" + message):
        Convex(points)


def test_shapes_of_lists_arrays_and_whole_numbers_are_the_same_values() -> None:
    assert Box([1, 2, 3]) == Box(np.array([1.0, 2.0, 3.0])) == Box((1.0, 2.0, 3.0))  # type: ignore[arg-type]
    assert hash(Convex(np.array(TETRAHEDRON))) == hash(Convex(TETRAHEDRON))  # type: ignore[arg-type]
    body = Body("a", Sphere(1), transform(), "box")
    assert '"sphere": 1.0' in str(body_to_json(body)).replace("'", '"')


SKEWED, FAR = np.eye(4), np.eye(4)
SKEWED[0, 1], FAR[0, 3] = 1e-5, INF
BROKEN = {
    "3x3": (np.eye(3), "shape (3, 3)"),
    "scaled": (np.diag([2.0, 2.0, 2.0, 1.0]), "lengths 2, 2, 2"),
    "mirrored": (np.diag([1.0, -1.0, 1.0, 1.0]), "right-handed"),
    "skewed": (SKEWED, "axes of the pose"),
    "nan": (np.full((4, 4), NAN), "not finite"),
    "far": (FAR, "not finite"),
    "projective": (np.eye(4) + np.eye(4, k=-3), "last row"),
    "text": ("pose", "'pose'"),
    "nothing": (None, "None"),
    "ragged": ([[1.0], [1.0, 2.0]], "4x4"),
}


@pytest.mark.parametrize("case", BROKEN)
def test_a_body_stands_at_a_rigid_pose(case: str) -> None:
    T, message = BROKEN[case]
    with pytest.raises(InputError) as caught:
        Body("crate", Box((0.1, 0.1, 0.1)), T, "box")
    assert "body 'crate': T_base_body" in str(caught.value)
    assert message in str(caught.value)
    with pytest.raises(InputError):
        poses("T", T)


def test_poses_of_every_kind_are_kept_to_the_bit_and_cannot_be_changed() -> None:
    rng = np.random.default_rng(4)
    many = np.stack([transform(rotation(rng.normal(size=3) * 3), rng.normal(size=3)) for _ in range(500)])
    assert np.array_equal(poses("T", many), many)
    for T in many:
        kept = Body("a", Sphere(0.1), np.array(T), "box").T_base_body
        assert np.array_equal(kept, T)
        assert not kept.flags.writeable
    noisy = many + rng.uniform(-1.0, 1.0, many.shape) * 0.1 * RIGID
    noisy[:, 3] = many[:, 3]
    for T in noisy:
        rigid("T", T)
        with pytest.raises(InputError):
            rigid("T", T @ np.diag([1.0, 1.0 + 10 * RIGID, 1.0, 1.0]))


def test_a_body_has_a_name_and_a_shape() -> None:
    for name, shape, kind in (("", Sphere(0.1), "box"), (1, Sphere(0.1), "box"), ("a", Sphere(0.1), None)):
        with pytest.raises(InputError, match="must be strings"):
            Body(name, shape, transform(), kind)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="body 'a': shape = 'sphere': must be a Box"):
        Body("a", "sphere", transform(), "box")  # type: ignore[arg-type]


def limits(**changed) -> Limits:  # type: ignore[no-untyped-def]
    given = {"lower": -np.ones(3), "upper": np.ones(3), "velocity": np.ones(3), "acceleration": np.ones(3)}
    return Limits(**{**given, **changed})


@pytest.mark.parametrize("key", ["lower", "upper", "velocity", "acceleration"])
@pytest.mark.parametrize(
    "wrong", [[0.5, NAN, 0.5], [0.5, INF, 0.5], [0.5, 0.5], 0.5, "abc", None, [[0.5] * 3]]
)
def test_limits_are_one_finite_number_per_joint(key: str, wrong) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(InputError, match=f"limits: {key}" if key != "lower" else "limits: "):
        limits(**{key: wrong})


@pytest.mark.parametrize("key", ["velocity", "acceleration"])
@pytest.mark.parametrize("value", [0.0, -1.0])
def test_velocity_and_acceleration_limits_must_be_finite_and_positive(key: str, value: float) -> None:
    with pytest.raises(InputError, match=rf"limits: {key}\[1\] = {value:g}: must be finite and above 0"):
        limits(**{key: [1.0, value, 1.0]})


def test_lower_limits_must_not_be_above_upper_limits() -> None:
    with pytest.raises(InputError, match=r"lower\[2\] = 2 is above upper\[2\] = 1"):
        limits(lower=[0.0, 0.0, 2.0])
    with pytest.raises(InputError, match="speed = 'a'"):
        limits().scaled("a")  # type: ignore[arg-type]


def test_limits_copy_their_arrays() -> None:
    mine = np.ones(3)
    made = limits(velocity=mine)
    mine[:] = -1.0
    assert np.array_equal(made.velocity, np.ones(3))


@pytest.mark.parametrize(
    "wrong", [[0, 1, 2], [[0, 1], [2, 3]], None, "ab", [0.0, NAN], [INF, 0.0], ["a", "b"]]
)
def test_a_configuration_is_one_finite_number_per_joint(wrong) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(InputError, match=r"q_to.*must be 2 finite numbers .*one for each of j1, j2"):
        joints("q_to", wrong, ("j1", "j2"))
    assert joints("q_to", [[1, 2]], ("j1", "j2")).tolist() == [1.0, 2.0]


def test_contacts_are_pairs() -> None:
    assert pairs("touching", [("a", "b")]) == {frozenset("ab")}
    for wrong in (["finger_l", "table"], "ab", [("a",)], [("a", "a")], [("a", "b", "c")], [(1, 2)], [3], 3):
        with pytest.raises(InputError, match=r"touching.*pairs of two names"):
            pairs("touching", wrong)  # type: ignore[arg-type]


def test_numbers_of_an_option_are_told_with_their_count() -> None:
    assert option_numbers("--q", "1,-2.5, 3", 3, "x").tolist() == [1.0, -2.5, 3.0]
    for text, told in {
        "1,5,2,5": "x, not 4; the decimal sign is a point",
        "1 2 3": "x, not 1",
        "": "x, not 1",
        "1;2;3": "x, not 1; ';' is no part of a number",
        "[1,2,3]": "x; '[' is no part of a number",
        "1,2,x": "x; 'x' is no part of a number",
        "1,2,1e999": "x",
    }.items():
        wrong = re.escape(f"--q={text}: must be 3 numbers separated by commas, {told}") + "$"
        with pytest.raises(InputError, match=wrong):
            option_numbers("--q", text, 3, "x")
