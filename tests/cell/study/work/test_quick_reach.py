"""Many placements at once are judged as each by itself."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from arm.errors import ImpossibleError
from cell.files.study import read_study
from cell.study.question.points import points_of
from cell.study.question.scratch import Scratch, bundle_of
from cell.study.work.quick_reach import QuickReach
from cell.study.work.stages import exact_look, reason_of, require_reach
from studies.written import write_study
from typed.command_line import replace_in

ANYWHERE = [
    {"key": "boards[0].centre_mm[0]", "from": 250.0, "to": 650.0},
    {"key": "boards[0].centre_mm[1]", "from": -300.0, "to": 300.0},
    {"key": "boards[0].centre_mm[2]", "from": -10.0, "to": 300.0},
    {"key": "boards[0].yaw_deg", "from": -180.0, "to": 180.0},
    {"key": "boards[0].tilt_deg", "from": 0.0, "to": 40.0},
    {"key": "boards[1].lean_azimuth_deg", "from": -180.0, "to": 180.0},
]


def _reached(scratch: Scratch) -> tuple[ImpossibleError | None, float]:
    try:
        return None, require_reach(scratch.task, exact_look(scratch.task, scratch.world))
    except ImpossibleError as error:
        return error, 0.0


@pytest.mark.parametrize("count", [24, pytest.param(400, marks=pytest.mark.slow)])
@pytest.mark.parametrize("cell", ["", "realistic/"])
def test_verdict_reason_and_margin_are_those_of_a465_reach(
    scenes: Path, tmp_path: Path, cell: str, count: int
) -> None:
    file = write_study(scenes, ANYWHERE, points=count, seed=7, task=f"{cell}task2.toml")
    study = read_study(file)
    scratch = Scratch(bundle_of(study), tmp_path)
    quick = QuickReach.of(study, scratch.task, scratch.world)
    assert quick is not None
    points = points_of(study, 0, count)
    verdicts = set()
    for values, outcome in zip(points, quick.outcomes(points), strict=True):
        scratch.set(values)
        error, margin = _reached(scratch)
        assert (outcome.ok, outcome.reason) == (error is None, reason_of(error) if error else ""), values
        if error is None:
            assert outcome.margin_deg == pytest.approx(margin, abs=1e-6)
        verdicts.add(outcome.reason)
    assert len(verdicts) >= 3


@pytest.mark.parametrize(
    "vary",
    [
        {"file": "cell", "key": "tool.length_mm", "from": 130.0, "to": 140.0},
        {"key": "noise_grey", "from": 1.0, "to": 2.0},
        {"key": "boards[0].tilt_deg", "from": 0.0, "to": 70.0},
    ],
)
def test_what_changes_more_than_poses_is_left_to_the_files(
    scenes: Path, tmp_path: Path, vary: dict[str, object]
) -> None:
    study = read_study(write_study(scenes, [vary], points=2))
    scratch = Scratch(bundle_of(study), tmp_path)
    assert QuickReach.of(study, scratch.task, scratch.world) is None


def test_points_do_not_depend_on_those_beside_them(scenes: Path, tmp_path: Path) -> None:
    study = read_study(write_study(scenes, ANYWHERE, points=20, seed=2))
    scratch = Scratch(bundle_of(study), tmp_path)
    quick = QuickReach.of(study, scratch.task, scratch.world)
    assert quick is not None
    points = points_of(study, 0, 20)
    together = quick.outcomes(points)
    apart = [quick.outcomes([values])[0] for values in points]
    assert [o.row() for o in together] == [o.row() for o in apart]
    assert np.isfinite([o.margin_deg for o in together if o.ok]).all()


def test_boards_that_stay_where_they_are_count(scenes: Path, tmp_path: Path) -> None:
    replace_in(scenes / "task2.world.toml", "centre_mm = [460, -130, 90]", "centre_mm = [900, -130, 90]")
    study = read_study(write_study(scenes, [ANYWHERE[3]], points=2))
    scratch = Scratch(bundle_of(study), tmp_path)
    quick = QuickReach.of(study, scratch.task, scratch.world)
    assert quick is not None
    (outcome,) = quick.outcomes([(175.0,)])
    assert (outcome.ok, outcome.reason) == (False, "beyond the arm's reach")
    assert outcome.detail.startswith("hole 03-04/")
