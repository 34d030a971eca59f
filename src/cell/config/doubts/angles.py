"""Angles given in deg that may be in rad."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from arm.controller.unit import Unit
from arm.se3 import Array

LITTLE_DEG = 0.2  # by which somebody who types the number would seldom turn a joint


def doubt_of_deg(q: Array, unit: Unit) -> str:
    """Say that a configuration given in deg, now q (6,) rad, may be in rad; "" if not.

    All are within pi then, one at least has decimals, and as rad they are within the limits.
    """
    stated = np.degrees(q)
    whole = np.allclose(stated, np.rint(stated), atol=1e-9)
    if whole or np.abs(stated).max() > np.pi + 0.01 or unit.beyond_limits(stated):
        return ""
    given, meant = (", ".join(f"{v:.6g}" for v in angles) for angles in (stated, np.degrees(stated)))
    return (
        f"[{given}]: is it in rad? Then it must be [{meant}] in deg; as it is, the arm is within 3.2 deg of zero in "
        "all joints"
    )


_HUNDREDTH = 0.0051  # rad, of angles with two decimals
_WHOLE = np.radians(5.0)  # angles are rather multiples of this


def doubt_of_small(stated: float | list[float]) -> str:
    """Say that angles given in deg may be in rad; "" if not.

    One at least is a multiple of 5 deg in rad to its two decimals or more, and none is more than a turn in rad.
    """
    values = np.atleast_1d(np.array(stated, dtype=float))
    given = np.abs(values[values != 0.0])
    meant = _WHOLE * np.rint(given / _WHOLE)
    has_decimals = np.abs(given - np.round(given, 1)) > 1e-9
    if not (has_decimals & (meant > 0.0) & (np.abs(given - meant) < _HUNDREDTH)).any():
        return ""
    if given.max() > 2.0 * np.pi + _HUNDREDTH or np.median(np.abs(given - meant)) > _HUNDREDTH:
        return ""
    in_deg = ", ".join(f"{v:.4g}" for v in np.degrees(values).tolist())
    in_deg = in_deg if values.shape == (1,) and not isinstance(stated, list) else f"[{in_deg}]"
    return f"{stated}: is it in rad? Then it must be {in_deg} in deg"


def doubt_of_turn(degrees: Sequence[float]) -> str:
    """Say that angles given in deg by which joints shall turn may be in rad, or are small; "" if neither."""
    most = max(map(abs, degrees))
    little = (
        f"the numbers are deg: the joints turn by at most {most:g} deg" if 0.0 < most < LITTLE_DEG else ""
    )
    return doubt_of_small(list(degrees)) or little
