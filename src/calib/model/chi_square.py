"""Quantiles of the chi-square distribution.

`scipy.stats` has them too, but takes longer to import than everything else that a calibration imports.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy.special import chdtri, gammaincinv

from arm.se3 import Array


def chi2_limit(chance: npt.ArrayLike, freedom: npt.ArrayLike) -> Array:
    """Value that chi-square with `freedom` degrees of freedom exceeds with probability `chance`."""
    return np.asarray(chdtri(freedom, chance))


def chi2_quantile(share: npt.ArrayLike, freedom: npt.ArrayLike) -> Array:
    """Value below which chi-square with `freedom` degrees of freedom is with probability `share`."""
    return np.asarray(2.0 * gammaincinv(np.asarray(freedom) / 2.0, share))
