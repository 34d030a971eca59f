"""What a list of poses may ask for."""

from __future__ import annotations

import numpy as np
import pytest

from arm.errors import InputError
from plan.program.goals.target import Target


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"free": "yaw"}, "free = 'yaw': must be one of x, y"),
        ({"by": "air"}, "by = 'air': must be one of transit, line"),
        ({"approach": -0.1}, "approach = -0.1"),
        ({"T_base_tool": 2 * np.eye(4)}, "target 'a': T_base_tool"),
        ({"allowed_collisions": [("a",)]}, "pairs of two names"),
    ],
)
def test_wrong_targets(change: dict[str, object], says: str) -> None:
    with pytest.raises(InputError, match=says):
        Target(**{"name": "a", "T_base_tool": np.eye(4), **change})
