"""The self-test of `a465 doctor` sees what is wrong."""

from __future__ import annotations

import os

import numpy as np
import pytest

from arm.io.storage import data_file
from cell.config.cell_file import read_cell
from cell.doctor import self_test as selftest
from cell.doctor.finding import WRONG, CheckResult, guarded

pytestmark = pytest.mark.xdist_group("doctor")


@pytest.mark.slow
def test_a_board_that_is_found_elsewhere_is_wrong(monkeypatch: pytest.MonkeyPatch) -> None:
    true = selftest.render
    monkeypatch.setattr(selftest, "render", lambda camera, *rest: np.roll(true(camera, *rest), 2, axis=1))
    found = guarded("look", selftest.check_detection, 60.0, "h")
    assert isinstance(found, CheckResult)
    assert found.verdict == WRONG
    assert found.data["off_m"] == pytest.approx(2 * 1.13 / 4740, rel=0.1)
    assert "more than 0.1 mm" in found.found


def test_a_plan_that_does_not_hold_is_wrong(monkeypatch: pytest.MonkeyPatch) -> None:
    cell = read_cell(data_file("scenes/cell.toml"))
    slower = cell.unit.limits().scaled(0.01)
    true = selftest.replay
    monkeypatch.setattr(selftest, "replay", lambda plan, scene, unit, limits: true(plan, scene, unit, slower))
    found = guarded("plan", lambda: selftest.check_motion(cell), 60.0, "h")
    assert isinstance(found, CheckResult)
    assert found.verdict == WRONG


def test_no_pseudo_terminal_is_wrong(monkeypatch: pytest.MonkeyPatch) -> None:
    def none() -> tuple[int, int]:
        raise OSError(28, "out of pty devices")

    monkeypatch.setattr(os, "openpty", none)
    cell = read_cell(data_file("scenes/cell.toml"))
    found = guarded("unit", lambda: selftest.check_unit(cell), 60.0, "is /dev/pts there?")
    assert isinstance(found, CheckResult)
    assert (found.verdict, found.help) == (WRONG, "is /dev/pts there?")
    assert "out of pty devices" in found.found
