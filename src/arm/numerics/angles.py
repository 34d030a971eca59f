"""Inverse trigonometric functions with the same bits on processors with and without AVX-512.

With AVX-512, numpy computes inverse functions with its own code, which rounds differently from the C library. A search
for a minimum can then end elsewhere. The functions here call the C library for each number, as numpy's sine and cosine
do. The C library distinguishes only processors with FMA (all since 2013) and without.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

_ATAN2 = np.frompyfunc(math.atan2, 2, 1)
_ACOS = np.frompyfunc(math.acos, 1, 1)
_ASIN = np.frompyfunc(math.asin, 1, 1)


def arctan2(y: npt.ArrayLike, x: npt.ArrayLike) -> Array:
    """Return the angle of (x, y) from the x axis, in [-pi, pi], rad; the arrays are broadcast."""
    return np.asarray(_ATAN2(y, x), dtype=float)


def arccos(x: npt.ArrayLike) -> Array:
    """Return the angle in [0, pi] with this cosine, rad; x is clipped to [-1, 1] against rounding errors."""
    return np.asarray(_ACOS(np.clip(x, -1.0, 1.0)), dtype=float)


def arcsin(x: npt.ArrayLike) -> Array:
    """Return the angle in [-pi/2, pi/2] with this sine, rad; x is clipped to [-1, 1] against rounding errors."""
    return np.asarray(_ASIN(np.clip(x, -1.0, 1.0)), dtype=float)
