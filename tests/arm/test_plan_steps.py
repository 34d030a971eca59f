"""Steps of a plan: how they make motions, how long they take, what may touch."""

from __future__ import annotations

import pytest

from arm.controller.segments import CountPath, Segment
from arm.errors import InputError
from arm.plan_steps import GripperStep, LookStep, Move, Pause, duration_of, motions, touching_pairs

ROW = (10, -20, 30, 0, 5, 1)
THERE = Move("there", "transit", 0, CountPath((0,) * 6, (Segment(100, (ROW, ROW, ROW)), Segment(80, (ROW,)))), None,
             0.06, 0.01, ("palm", "table"))  # fmt: skip
BACK = Move("back", "retract", 0, CountPath(THERE.path.end, (Segment(100, (ROW,)),)), "cube 1", 0.04, 0.02,
            ("palm", "wall"), True, ("plate", "table"), (0.02,), (("box", "finger_l"),))  # fmt: skip
CLOSE = GripperStep("close", "close", 0, 0.4, 1.0)


def test_moves_with_nothing_between_make_one_motion() -> None:
    found = motions((CLOSE, THERE, BACK, LookStep("look"), THERE, Pause("a", 0.5), BACK))
    assert [(m.first, m.moves) for m in found] == [(1, (THERE, BACK)), (4, (THERE,)), (6, (BACK,))]
    assert found[0].starts == (0, 2)
    assert found[0].path.segments == (*THERE.path.segments, *BACK.path.segments)
    assert (found[0].path.start, found[0].path.end) == (THERE.path.start, BACK.path.end)
    assert motions(()) == ()
    with pytest.raises(InputError, match="path 1 of the chain starts at"):
        _ = motions((THERE, THERE))[0].path


def test_what_a_step_takes_at_least() -> None:
    assert [duration_of(step) for step in (THERE, CLOSE, LookStep("look"), Pause("a", 0.5))] == [
        0.18,
        1.0,
        0.0,
        0.5,
    ]


def test_what_may_touch_is_the_held_body_s_and_the_move_s_own() -> None:
    assert touching_pairs(THERE) == frozenset()
    assert touching_pairs(BACK) == {
        frozenset(("cube 1", "plate")), frozenset(("cube 1", "table")), frozenset(("box", "finger_l")),
    }  # fmt: skip
