"""How errors of an arm's parameters move its tool: one screw in the base frame per error.

Every error of a Denavit-Hartenberg parameter moves all that lies behind it about, or along, one line: a joint offset
and d the z axis before the joint's turn, a and alpha the x axis behind it (S. A. Hayati, 1983, for arms whose axes are
not nearly parallel). A small error times its screw is the twist of the tool.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from arm.numerics.products import mul
from arm.robot.dh import DhTable
from arm.robot.link_errors import LinkErrors
from arm.se3 import Array, cross, rot_x, rot_z, transform

KINDS = ("offset", "d", "a", "alpha")
"""The order of the errors: each for all joints."""


def error_screws(dh: DhTable, links: LinkErrors, q: npt.ArrayLike) -> Array:
    """Return the screws of joint offsets, d, a and alpha, (6, 4 joints): twists in the base frame, translation first.

    Those of d, a and alpha of the last link are zero, because `with_link_errors` does not apply them.

    Args:
        dh: nominal parameters.
        links: corrections to them.
        q: joint positions (joints,), rad.
    """
    n = dh.joints
    screws = np.zeros((6, len(KINDS), n))
    T_base_link = np.eye(4)
    for j, angle in enumerate(np.asarray(q, dtype=float)):
        last = j + 1 == n
        d, a, alpha = (0.0, 0.0, 0.0) if last else (links.d[j], links.a[j], links.alpha[j])
        z, origin = T_base_link[:3, 2], T_base_link[:3, 3]
        turned = mul(T_base_link, transform(rot_z(float(angle + dh.theta_offset[j]))))
        moved = mul(turned, transform(t=(float(dh.a[j] + a), 0.0, float(dh.d[j] + d))))
        x, end = turned[:3, 0], moved[:3, 3]
        screws[:, 0, j] = (*cross(origin, z), *z)
        if not last:
            screws[:3, 1, j], screws[:3, 2, j] = z, x
            screws[:, 3, j] = (*cross(end, x), *x)
        T_base_link = mul(moved, transform(rot_x(float(dh.alpha[j] + alpha))))
    return screws.reshape(6, -1)
