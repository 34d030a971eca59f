"""Inverse functions: numpy's to an ulp, the C library's to the last bit, whatever the shapes."""

from __future__ import annotations

import math

import numpy as np

from arm.numerics.angles import arccos, arcsin, arctan2


def test_results_equal_those_of_the_c_library() -> None:
    rng = np.random.default_rng(3)
    y, x = rng.normal(size=(7, 5)), rng.normal(size=5)
    assert arctan2(y, x).tolist() == [[math.atan2(a, b) for a, b in zip(row, x, strict=True)] for row in y]
    c = rng.uniform(-1.0, 1.0, size=40)
    assert arccos(c).tolist() == [math.acos(v) for v in c]
    assert arcsin(c).tolist() == [math.asin(v) for v in c]


def test_scalars_and_empty_arrays_keep_their_shape() -> None:
    assert float(arctan2(1.0, 0.0)) == math.pi / 2
    assert arctan2(np.zeros((0, 3)), np.zeros(3)).shape == (0, 3)


def test_arguments_just_above_1_are_clipped() -> None:
    assert float(arccos(1.0 + 1e-15)) == 0.0
    assert float(arcsin(np.array(-1.0 - 1e-15))) == -math.pi / 2
