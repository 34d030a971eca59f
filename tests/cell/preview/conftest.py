"""What tests of the preview share: a page in a browser, and the plan of a logged session."""

from __future__ import annotations

from pathlib import Path

import pytest

from arm.controller.segments import CountPath
from arm.controller.unit import Unit, load_unit
from arm.plan_file import GripperStep, Plan
from pages.logged import move
from pages.preview import write_case
from wire.logged_session import LoggedRun


@pytest.fixture(scope="module")
def page_file(preview_case, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("preview") / "plan.html"
    write_case(preview_case, path)
    return path


@pytest.fixture(scope="module")
def unit() -> Unit:
    return load_unit("crs93")


@pytest.fixture
def plan(run: LoggedRun, unit: Unit) -> Plan:
    """The first motion in two moves, the jaws, and the motion that was stopped."""
    segments, middle = run.whole.segments, tuple(int(c) for c in run.whole.knots()[20])
    parts = (CountPath(run.whole.start, segments[:20]), CountPath(middle, segments[20:]))
    return Plan(
        task={"name": "no-such-task", "cubes": []},
        unit="crs93",
        speed=1.0,
        speed_registers=unit.speed_registers,
        acceleration_registers=unit.acceleration_registers,
        steps=(
            GripperStep("open", "open", None, 0.0, 0.2),
            move("first", parts[0]),
            move("second", parts[1]),
            GripperStep("close", "close", None, 1.0, 0.2),
            move("back", run.cut),
        ),
        provenance={"task": "0" * 64},
    )
