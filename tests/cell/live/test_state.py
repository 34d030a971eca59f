"""What the live page is told."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from arm.controller.segments import CountPath, Segment
from cell.live.state import MOST_SAMPLES, Begun, Ended, LiveState, Told
from cell.preview.executed import OnPath
from cell.preview.timeline import timed_steps
from driver.execution.control import Control
from pages.live import UNIT, new_plan, told_by
from wire.looks_at_motion import looks


def test_a_sample_is_on_the_plans_clock_where_the_arm_is(preview_case) -> None:
    """Over moves that are one motion, under an override, and whether the arm is on the path or beside it."""
    plan, state = preview_case.plan, LiveState()
    timed, expected, shown = timed_steps(plan), [], []
    state.take(new_plan(plan))
    motion = max(plan.motions, key=lambda m: len(m.moves))
    assert len(motion.moves) == 3
    for k, move in enumerate(motion.moves):
        index = motion.first + k
        assert told_by(state.take(move))[0] == (
            "step",
            {"index": index, "name": move.name, "t": round(timed[index].start_s, 6)},
        )
        for t, progress in looks(move, stretch=1.0 + 0.25 * k, off=3):
            ((name, sample),) = told_by(state.take(progress))
            assert name == "sample"
            assert sample["motion"] == motion.first
            assert sample["counts"] == list(progress.position.counts)
            assert sample["override"] == round(progress.override, 4)
            assert (sample["done"], sample["total"]) == (progress.done, progress.total)
            expected.append(timed[index].start_s + t)
            shown.append(sample["t"])
    assert np.all(np.diff(shown) >= 0.0)
    off = np.abs(np.subtract(shown, expected))
    assert np.median(off) < 0.01
    assert off.max() < 0.3  # where it begins and ends, three counts are a long time


def test_a_sample_is_never_laid_behind_the_one_before() -> None:
    """Out and back on the same way: where the arm is does not tell which."""
    there, back = (Segment(1000, ((way, 0, 0, 0, 0, 0),)) for way in (20_000, -20_000))
    path = CountPath((0,) * 6, (there, back))
    on_path, times = OnPath(path, UNIT), np.arange(0.0, 2.0, 0.1)
    shown = [on_path.place(UNIT.positions(path.at([t])[0]), None)[0] for t in times]
    assert shown == pytest.approx(times, abs=1e-3)


def test_a_step_of_no_plan_has_a_name_alone(preview_case) -> None:
    plan, state = preview_case.plan, LiveState()
    move = next(plan.moves)
    state.take(new_plan(plan))
    state.take(replace(move, name="back out"))
    ((_, sample),) = told_by(state.take(next(looks(move))[1]))
    assert (sample["motion"], sample["t"]) == (None, None)
    told = dict(told_by(state.snapshot()))
    assert told["step"] == {"index": None, "name": "back out", "t": None}


def test_pauses_and_the_end_are_told_once(preview_case) -> None:
    control, state = Control(), LiveState()
    state.take(Begun(control))
    assert told_by(state.take(new_plan(preview_case.plan)))[-1][0] == "plan"
    assert told_by(state.take(preview_case.plan.steps[0]))[-1] == ("state", {"state": "runs"})
    assert state.changes() == []
    control.paused = True
    assert told_by(state.changes()) == [("state", {"state": "pauses"})]
    control.standing = True
    assert told_by(state.take(Told("paused: the arm stands"))) == [
        ("told", {"lines": ["paused: the arm stands"]}),
        ("state", {"state": "stands"}),
    ]
    control.paused = control.standing = False
    assert told_by(state.changes()) == [("state", {"state": "runs"})]
    assert told_by(state.take(Ended("stopped: why"))) == [
        ("state", {"state": "ended", "text": "stopped: why"})
    ]
    assert told_by(state.snapshot())[-1] == ("state", {"state": "ended", "text": "stopped: why"})


def test_a_new_plan_begins_anew_and_memory_is_bounded(preview_case) -> None:
    plan, state = preview_case.plan, LiveState()
    move = next(plan.moves)
    _, progress = next(looks(move))
    state.take(new_plan(plan, "to-start", b"first"))
    state.take(move)
    for _ in range(MOST_SAMPLES + 5):
        state.take(progress)
    past = dict(told_by(state.snapshot()))["past"]
    assert len(past["samples"]) == MOST_SAMPLES
    assert len(b"".join(state.snapshot())) < 4e6
    state.take(new_plan(plan, "plan", b"second"))
    told = told_by(state.snapshot())
    assert state.page == b"second"
    assert [name for name, _ in told] == ["plan", "past", "state"]
    assert told[0][1] == {"mark": "run-plan", "name": "plan", "sha256": plan.sha256}
    assert told[1][1]["samples"] == []
    assert told[2][1] == {"state": "waits"}
