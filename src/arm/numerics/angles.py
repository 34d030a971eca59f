"""Angles of ratios, the same to the last bit on processors with AVX-512 and without.

On processors with AVX-512 numpy computes inverse functions with code of its own, which rounds otherwise than the C
library's. A search that takes the least of many then ends elsewhere. Here each number goes to the C library, as numpy's
sine and cosine do anyway. The library itself has code for processors with FMA (all since 2013) and without.
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
    """The angle of (x, y) from the x axis, in [-pi, pi], rad; arrays of any shapes that go together."""
    return np.asarray(_ATAN2(y, x), dtype=float)


def arccos(x: npt.ArrayLike) -> Array:
    """The angle in [0, pi] with this cosine, rad; what is beyond -1 or 1 by rounding counts as that."""
    return np.asarray(_ACOS(np.clip(x, -1.0, 1.0)), dtype=float)


def arcsin(x: npt.ArrayLike) -> Array:
    """The angle in [-pi/2, pi/2] with this sine, rad; what is beyond -1 or 1 by rounding counts as that."""
    return np.asarray(_ASIN(np.clip(x, -1.0, 1.0)), dtype=float)
