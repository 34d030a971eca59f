"""Lines of a list of poses."""

from __future__ import annotations

import numpy as np

from arm.se3 import angle_between, rot_x, rot_z, transform
from plan.program.goals.line_chains import _nearest
from plan.program.goals.target import Target
from tasks.pose_lists import down


def test_a_line_keeps_what_is_free_as_it_is() -> None:
    T, now = down(0.4, 0.1, 0.2), down(0.5, 0.3, 0.25) @ transform(rot_x(0.3)) @ transform(rot_z(0.4))
    shifted = _nearest(now, Target("t", T, free=("x", "y")))
    np.testing.assert_allclose(shifted[:3, 3], (0.5, 0.3, 0.2), atol=1e-12)
    np.testing.assert_allclose(shifted[:3, :3], T[:3, :3], atol=1e-12)
    turned = _nearest(now, Target("t", T, free="rz"))
    np.testing.assert_allclose(turned[:3, 2:], T[:3, 2:], atol=1e-12)
    nearest = angle_between(turned[:3, :3], now[:3, :3])
    for angle in (-0.01, 0.01):
        assert angle_between(turned[:3, :3] @ rot_z(angle), now[:3, :3]) > nearest
    np.testing.assert_allclose(
        _nearest(now, Target("t", T, free=("rx", "ry", "rz")))[:3, :3], now[:3, :3], atol=1e-9
    )
