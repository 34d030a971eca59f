"""What the live page is told."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from arm.controller.segments import CountPath, Segment
from cell.export.timeline import timed_steps
from cell.live.state import MOST_SAMPLES, LiveState
from cell.preview.executed import OnPath
from driver.execution.control import Control
from pages.live import UNIT, new_plan
from wire.looks_at_motion import looks


def test_a_sample_is_on_the_plans_clock_where_the_arm_is(preview_case) -> None:
    """Over moves that are one motion, under an override, and whether the arm is on the path or beside it."""
    plan, state = preview_case.plan, LiveState()
    timed, expected, shown = timed_steps(plan), [], []
    new_plan(plan)(state)
    motion = max(plan.motions, key=lambda m: len(m.moves))
    assert len(motion.moves) == 3
    for k, move in enumerate(motion.moves):
        index = motion.first + k
        state.enter(move)
        start = round(timed[index].start_s, 6)
        assert state.since(0)["step"] == {"index": index, "name": move.name, "t": start}
        for t, progress in looks(move, stretch=1.0 + 0.25 * k, off=3):
            before = state.version
            state.sample(progress)
            (sample,) = state.since(before)["samples"]
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
    new_plan(plan)(state)
    state.enter(replace(move, name="back out"))
    state.sample(next(looks(move))[1])
    shown = state.since(0)
    assert [(s["motion"], s["t"]) for s in shown["samples"]] == [(None, None)]
    assert shown["step"] == {"index": None, "name": "back out", "t": None}


def word(state: LiveState) -> tuple[str, str | None]:
    """What is said of the run, and its reason."""
    shown = state.since(0)
    return shown["state"], shown.get("text")


def test_pauses_and_the_end_are_new_versions(preview_case) -> None:
    control, state = Control(), LiveState()
    state.begin(control)
    new_plan(preview_case.plan)(state)
    assert word(state) == ("waits", None)
    state.enter(preview_case.plan.steps[0])
    assert word(state) == ("runs", None)
    state.refresh()
    before = state.version
    state.refresh()
    assert state.version == before, "nothing has changed"
    for paused, standing, said in ((True, False, "pauses"), (True, True, "stands"), (False, False, "runs")):
        control.paused, control.standing = paused, standing
        state.refresh()
        assert (word(state), state.version) == ((said, None), before + 1)
        before = state.version
    state.end("stopped: why")
    assert state.version > before
    assert word(state) == ("ended", "stopped: why")


def test_who_asks_again_gets_what_is_new_and_nothing_twice(preview_case) -> None:
    state = LiveState()
    move = next(preview_case.plan.moves)
    samples = [progress for _, progress in looks(move)][:6]
    new_plan(preview_case.plan)(state)
    state.enter(move)
    lines, counts, version = [], [], 0
    for k, progress in enumerate(samples):
        state.sample(progress)
        state.say(f"line {k}")
        if k % 2:
            shown = state.since(version)
            version = shown["version"]
            lines += shown["lines"]
            counts += [sample["counts"] for sample in shown["samples"]]
    assert lines == [f"line {k}" for k in range(6)]
    assert counts == [list(progress.position.counts) for progress in samples]
    assert (state.since(version)["lines"], state.since(version)["samples"]) == ([], [])
    assert state.since(version)["step"] == state.since(0)["step"], "what is now, every time"
    assert LiveState().since(0)["run"] != state.since(0)["run"]


def test_a_new_plan_begins_anew_and_memory_is_bounded(preview_case) -> None:
    plan, state = preview_case.plan, LiveState()
    move = next(plan.moves)
    _, progress = next(looks(move))
    new_plan(plan, "to-start", b"first")(state)
    state.enter(move)
    for _ in range(MOST_SAMPLES + 5):
        state.sample(progress)
    assert len(state.since(0)["samples"]) == MOST_SAMPLES
    assert len(json.dumps(state.since(0))) < 4e6
    new_plan(plan, "plan", b"second")(state)
    assert state.page == b"second"
    shown = state.since(0)
    assert shown["plan"] == {"mark": "run-plan", "name": "plan", "sha256": plan.sha256}
    assert (shown["samples"], shown["step"], shown["state"]) == ([], None, "waits")
