"""Joint angles given in deg that may be in rad."""

from __future__ import annotations

import numpy as np

from arm.controller.unit import Unit
from arm.se3 import Array


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
