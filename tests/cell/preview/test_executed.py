"""A log shown over its plan: the motions are found, each sample at its place, and what is not at hand is told."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from arm.controller.segments import CountPath
from arm.controller.unit import Unit
from arm.plan_file import Move, Plan
from cell.preview.executed import match
from driver.log.motions import LoggedMotion
from driver.log.read import Session
from driver.log.samples import LoggedSample
from pages.logged import move
from wire.logged_session import LoggedRun

pytestmark = pytest.mark.xdist_group("logs")


def test_motions_of_the_log_are_found_in_the_plan_whole_or_in_part(
    session: Session, plan: Plan, unit: Unit
) -> None:
    whole, part = match(session, plan, unit)
    assert (whole.executed.step, part.executed.step) == (1, 4)
    assert part.lasted_s is None
    assert whole.lasted_s is not None
    assert 0.98 * whole.planned_s <= whole.lasted_s <= 1.6 * whole.planned_s  # a busy host hears late
    for found in (whole, part):
        assert np.all(np.diff(found.executed.time_s) >= 0.0)
        assert np.degrees(np.abs(found.difference)).max() <= 0.02
    assert whole.executed.time_s[0] == 0.0
    assert whole.executed.time_s[-1] > 0.9 * whole.planned_s


def test_each_sample_is_laid_where_the_arm_was_on_the_path(
    session: Session, plan: Plan, unit: Unit, run: LoggedRun
) -> None:
    whole, _ = match(session, plan, unit)
    there = unit.positions(run.whole.at(whole.executed.time_s))
    assert np.abs(there - unit.positions(whole.executed.counts)).max() <= np.radians(0.02)


def test_an_arm_off_its_path_is_shown_as_far_off_as_it_was(session: Session, plan: Plan, unit: Unit) -> None:
    """Every sample of the log moved by a degree of the second joint, which the path hardly moves."""
    shift = round(np.radians(1.0) * unit.counts_per_rad[1])

    def pushed_sample(sample: LoggedSample) -> LoggedSample:
        first, second, *rest = sample.position.counts
        return replace(sample, position=replace(sample.position, counts=(first, second + shift, *rest)))

    def pushed(motion: LoggedMotion) -> LoggedMotion:
        return replace(motion, samples=tuple(pushed_sample(s) for s in motion.samples))

    whole, _ = match(replace(session, motions=tuple(pushed(m) for m in session.motions)), plan, unit)
    assert np.degrees(whole.difference[:, 1]).max() == pytest.approx(1.0, abs=0.05)


def test_a_stretched_motion_is_still_the_plans_and_another_is_not(
    session: Session, plan: Plan, unit: Unit, run: LoggedRun
) -> None:
    def slower(path: CountPath) -> CountPath:
        return CountPath(path.start, tuple(replace(s, duration_ms=2 * s.duration_ms) for s in path.segments))

    steps = tuple(replace(s, path=slower(s.path)) if isinstance(s, Move) else s for s in plan.steps)
    slow = match(session, replace(plan, steps=steps), unit)
    assert [m.executed.step for m in slow] == [1, 4]
    assert slow[0].executed.time_s[-1] > 0.9 * 2 * slow[0].planned_s  # on the plan's own clock
    turned = tuple(replace(s, coefficients=s.coefficients[::-1]) for s in run.cut.segments)
    other = replace(plan, steps=(move("other", CountPath(run.cut.start, turned)),))
    assert match(session, other, unit) == ()
