"""Shapes as coal has them against points of their surfaces."""

from __future__ import annotations

import coal
import numpy as np
import pytest

from arms.around import KINDS, surface
from arms.grazing import obstacle
from plan.collision.narrow.coal_shapes import coal_shape


@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind != "torus"])
def test_coal_has_the_same_extent(kind: str) -> None:
    rng = np.random.default_rng(1)
    for _ in range(10):
        shape = obstacle(kind, rng)
        points, geometry = surface(shape, rng, 4000), coal_shape(shape)
        geometry.computeLocalAABB()
        box: coal.AABB = geometry.aabb_local
        size = np.ptp(points, axis=0).max()
        assert (points.min(axis=0) >= box.min_ - 1e-9).all()
        assert (points.max(axis=0) <= box.max_ + 1e-9).all()
        assert points.min(axis=0) == pytest.approx(box.min_, abs=0.1 * size)
        assert points.max(axis=0) == pytest.approx(box.max_, abs=0.1 * size)
