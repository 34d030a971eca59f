"""Jaws centre and align what they grip; a cube that is turned by quarters is the same cube."""

from __future__ import annotations

import numpy as np
import pytest

from arm.se3 import rot_x, rot_z, rotation, transform
from cell.sim.grip import angle_to_jaws, angle_to_square, between_jaws


def test_turns_of_a_cube_that_look_alike_count_as_none() -> None:
    rng = np.random.default_rng(7)
    for _ in range(50):
        quarter = rot_z(np.pi / 2 * rng.integers(4)) @ rot_x(np.pi / 2 * rng.integers(4))
        small = rotation(0.1 * rng.normal(size=3))
        wanted = float(np.arccos((np.trace(small) - 1) / 2))
        assert angle_to_square(quarter @ small) == pytest.approx(wanted, abs=1e-9)


@pytest.mark.parametrize("seed", range(20))
def test_jaws_centre_a_cube_and_align_it_with_their_faces(seed: int) -> None:
    """The rest stays: the place along the fingers, and the rotation about the jaws' travel."""
    rng = np.random.default_rng(seed)
    about_y, (x, y, z) = rng.normal(0.0, 0.02), rng.normal(0.0, 1e-3, 3)
    quarter = rot_z(np.pi / 2.0 * rng.integers(4))
    aligned = transform(rotation((0.0, about_y, 0.0)) @ quarter, (x, 0.0, z))
    assert between_jaws(aligned) == pytest.approx(aligned, abs=1e-12)
    a, b = rng.normal(0.0, 0.02, 2)
    held = between_jaws(transform(rotation((a, 0.0, b)) @ aligned[:3, :3], (x, y, z)))
    assert held == pytest.approx(aligned, abs=1e-3)  # small rotations about other axes commute nearly
    assert held[:3, 3] == pytest.approx((x, 0.0, z), abs=1e-12)
    assert np.abs(held[1, :3]).max() == pytest.approx(1.0, abs=1e-12)
    assert angle_to_jaws(held[:3, :3]) == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize("lean", [0.0, 0.1, 0.5, -0.3])
def test_the_angle_of_a_cube_to_the_jaws_is_that_of_its_nearest_face(lean: float) -> None:
    for about_travel in (0.0, 0.4, 2.0):
        R = rotation((lean, 0.0, 0.0)) @ rotation((0.0, about_travel, 0.0))
        assert angle_to_jaws(R) == pytest.approx(abs(lean), abs=1e-7)
