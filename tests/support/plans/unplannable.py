"""Tasks that cannot be planned, and advice on them."""

from __future__ import annotations

import numpy as np
import pytest

from arm.errors import ImpossibleError
from plan.advice.changes import Request
from plan.advice.search import Advice, advise
from plan.failure import (
    Failure,
    failure_from_json,
    failure_in,
)
from plan.program.tasks import plan_task
from tasks.refused import UNIT
from tasks.task2 import Q_START


def rng(seed: int) -> np.random.Generator:
    return np.random.default_rng([seed, 9])


def refused(asked: Request) -> tuple[ImpossibleError, Failure]:
    with pytest.raises(ImpossibleError) as caught:
        asked.plan()
    failure = failure_in(caught.value)
    assert failure is not None
    assert failure_from_json(failure.to_json()) == failure
    assert str(caught.value) == failure.headline
    assert "\n" not in failure.headline
    return caught.value, failure


def advice_that_holds(asked: Request, error: ImpossibleError, budget: int = 6) -> tuple[Advice, ...]:
    """The advice, each piece planned again from nothing but the changed scene."""
    tried: list[str] = []
    found = advise(asked, error, budget, tell=tried.append)
    assert len(tried) <= budget
    for piece in found:
        new = piece.change.apply(asked)
        plan = plan_task(new.scene, new.transfers, Q_START, UNIT, new.limits, new.options, places=new.places)
        assert plan.duration_s == piece.motion_s
        assert all(m.certified for m in plan.moves)
        assert len(plan.task["cubes"]) == piece.left
        assert f"{plan.duration_s:.1f} s" in piece.text
    return found
