"""Changes of a request."""

from __future__ import annotations

import pytest

from plan.advice.changes import MoveBodies, groups_of
from tasks.refused import request
from tasks.task2 import task2


def test_a_board_goes_with_its_stand_and_cubes_and_a_raised_stand_keeps_its_foot() -> None:
    asked = request(task2(cubes=2))
    groups = groups_of(asked.scene, asked.stations())
    assert groups["board 01-02"] == {"plate 01-02", "stand 01-02", "cube 1", "cube 2", "cube 3", "cube 4"}
    raised = MoveBodies("up", "board 03-04", groups["board 03-04"], by=(0.0, 0.0, 0.05)).apply(asked)
    stands = [next(b for b in r.scene.bodies if b.name == "stand 03-04") for r in (asked, raised)]
    low, high = ((s.T_base_body[2, 3] - s.shape.size[2] / 2, s.shape.size[2]) for s in stands)
    assert high == pytest.approx((low[0], low[1] + 0.05), abs=1e-12)
