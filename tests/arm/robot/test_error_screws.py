"""Screws of an arm's errors are the derivatives of its kinematics."""

from __future__ import annotations

import numpy as np
import pytest

from arm.robot.dh import A465
from arm.robot.error_screws import error_screws
from arm.robot.link_errors import LinkErrors, with_link_errors
from arm.robot.model import load_a465
from arm.se3 import Array, frozen, inverse, rotation_vector

STEP = 1e-6
ARM = load_a465(0.134112, 0.06)


def _links(rng: np.random.Generator) -> LinkErrors:
    return LinkErrors(*(frozen(size * rng.standard_normal(6)) for size in (1e-3, 1e-3, 5e-3)))


def _moved_by(errors: Array, links: LinkErrors, q: Array) -> Array:
    """Pose of the tool with errors (24,) of offsets, d, a and alpha."""
    offsets, d, a, alpha = errors.reshape(4, 6)
    off = LinkErrors(links.d + d, links.a + a, links.alpha + alpha)
    return with_link_errors(ARM, A465, off).T_base_tool(q + offsets)


@pytest.mark.parametrize("seed", range(6))
def test_each_screw_is_the_derivative_of_the_tools_pose(seed: int) -> None:
    rng = np.random.default_rng(seed)
    links, q = _links(rng), rng.uniform(-1.5, 1.5, 6)
    screws = error_screws(A465, links, q)
    assert screws.shape == (6, 24)
    for k, step in enumerate(STEP * np.eye(24)):
        change = _moved_by(step, links, q) @ inverse(_moved_by(-step, links, q))  # a motion in the base frame
        twist = np.append(change[:3, 3], rotation_vector(change[:3, :3])) / (2.0 * STEP)
        assert twist == pytest.approx(screws[:, k], abs=1e-5), k


def test_the_last_link_is_the_tools() -> None:
    screws = error_screws(A465, LinkErrors.none(), np.full(6, 0.4)).reshape(6, 4, 6)
    assert not screws[:, 1:, 5].any()
    assert screws[:, 0].any(axis=0).all()
