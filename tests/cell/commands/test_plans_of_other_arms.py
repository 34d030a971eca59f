"""Plans of arms without a unit on the command line: checked, shown and exported from the file alone, never sent."""

from __future__ import annotations

import csv
import json
import re
import shutil
from pathlib import Path

import numpy as np
import pytest

from arm.io.storage import data_file
from arm.plan_file import read_plan, write_plan
from cell.export.scene import surroundings_of_plan
from cell.export.urdf import describe
from plan.program.planned import Planned
from plans.other_arms import OTHER_ARMS, six_joints
from tasks.described import Exported, require_read
from typed.command_line import a465, replace_in

CELL = data_file("scenes/cell.toml")


@pytest.fixture(scope="module", params=OTHER_ARMS.values(), ids=OTHER_ARMS)
def planned(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Planned:
    """A plan whose URDF no longer exists."""
    folder = tmp_path_factory.mktemp("arm")
    found = request.param(folder)
    assert isinstance(found, Planned)
    for urdf in folder.glob("*.urdf"):
        urdf.unlink()
    return found


@pytest.fixture
def file(planned: Planned, tmp_path: Path) -> Path:
    write_plan(tmp_path / "plan.json", planned.plan())
    return tmp_path / "plan.json"


def test_check_proves_what_the_file_states(planned: Planned, file: Path) -> None:
    said, _ = a465("check", file)
    assert f"{len(planned.moves)} moves verified" in said
    told = json.loads(a465("check", file, "--json")[0])
    assert [m["name"] for m in told["moves"]] == [m.name for m in planned.moves]
    assert told["min_clearance_mm"] >= 1e3 * planned.clearance - 2e-3
    assert abs(told["second_opinion"]["percent"]) < 5.0


def test_check_refuses_a_body_that_was_moved_into_the_way(planned: Planned, file: Path) -> None:
    plan = planned.plan()
    post = next(b for b in plan.scene["bodies"] if b["name"] == "post")
    tool = planned.robot.T_base_tool(planned.at([planned.moves[-1].path.duration_s])[0])
    moved = {**post, "T_base_body": tool.tolist()}
    bodies = [moved if b is post else b for b in plan.scene["bodies"]]
    file.write_text(json.dumps({**json.loads(plan.to_json()), "scene": {**plan.scene, "bodies": bodies}}))
    _, told = a465("check", file, code=3)
    assert re.search("refused: .* of .*post.*; the plan states", told)


def test_the_page_has_the_arm_and_no_code(planned: Planned, file: Path) -> None:
    a465("preview", file)
    embedded = re.search(
        r'<script id="content" type="application/json">(.*?)</script>',
        file.with_suffix(".html").read_text(),
        re.S,
    )
    assert embedded is not None
    content = json.loads(embedded[1])
    assert content["joints"]["names"] == list(planned.robot.joint_names)
    assert [b["name"] for b in content["arm"]["bodies"]] == [b.name for b in planned.robot.bodies]
    assert content["code"] is None
    slides = [not joint["revolute"] for joint in content["arm"]["chain"]]
    assert slides == [name == "j3" for name in planned.robot.joint_names]
    # where bodies may touch, the smallest clearance that is shown is of others
    shown = [d for samples in content["clearance"].values() for d in samples["distance"]]
    assert min(shown) >= planned.clearance - 2e-6


def test_tables_and_messages_have_the_motion_under_the_joints_names(planned: Planned, file: Path) -> None:
    names = list(planned.robot.joint_names)
    a465("export", file, "-o", file.with_suffix(".csv"))
    with file.with_suffix(".csv").open() as stream:
        rows = list(csv.DictReader(stream))
    units = ["m" if name == "j3" else "rad" for name in names]
    columns = [f"{name}_{unit}" for name, unit in zip(names, units, strict=True)]
    assert list(rows[0])[1:-2] == [*columns, *(f"{column}_s" for column in columns)]
    times = np.array([float(row["time_s"]) for row in rows])
    assert times[-1] == pytest.approx(planned.duration_s)
    q = np.array([[float(row[column]) for column in columns] for row in rows])
    np.testing.assert_allclose(q, planned.at(times), atol=2e-9)

    a465("export", file, "--format", "trajectory", "-o", file.with_suffix(".trajectory.json"))
    trajectory = json.loads(file.with_suffix(".trajectory.json").read_text())
    assert trajectory["joint_names"] == names
    assert trajectory["points"][-1]["positions"] == pytest.approx(planned.q_end, abs=1e-6)
    a465("export", file, "--format", "mcap")
    content = file.with_suffix(".mcap").read_bytes()
    assert all(f'"{name}"'.encode() in content for name in names)


def test_the_urdf_is_the_arm_among_the_bodies_of_the_plan(planned: Planned, file: Path) -> None:
    folder = file.parent / "described"
    a465("export", file, "--format", "urdf", "-o", folder)
    there = surroundings_of_plan(file, read_plan(file), None)
    exported = Exported(folder)
    require_read(there, describe(there).links, exported, seed=3)
    at = exported.model.referenceConfigurations["q_start"]
    indices = [exported.model.joints[exported.model.getJointId(n)].idx_q for n in planned.robot.joint_names]
    assert at[indices] == pytest.approx(planned.q_start, abs=1e-6)


@pytest.fixture(scope="module")
def six(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("six")
    write_plan(folder / "plan.json", six_joints(folder).plan())
    return folder / "plan.json"


def test_such_a_plan_is_never_sent_and_needs_no_cell(six: Path) -> None:
    task = data_file("scenes/task2.toml")
    _, told = a465("execute", six, task, code=3)
    assert "for an arm without a controller's unit (unit none), and is never sent; a465 export" in told
    for words in (("check", six, task), ("preview", six, task), ("export", six, "--cell", CELL)):
        _, told = a465(*words, code=2)
        assert f"plan.json: arm: is the plan's own, which needs no cell; leave out {words[-1]}" in told


def test_what_is_missing_is_told_by_file_key_and_value(six: Path, tmp_path: Path) -> None:
    file = tmp_path / "plan.json"
    shutil.copy(six, file)
    replace_in(file, '"unit":"none"', '"unit":"crs93"')
    for verb in ("check", "preview"):
        _, told = a465(verb, file, code=2)
        assert f"plan.json is a plan of crs93; give its task or cell file too: a465 {verb}" in told
    replace_in(file, '"unit":"crs93"', '"unit":"none"')
    replace_in(file, '"arm":', '"robot":')
    for verb in ("check", "preview", "export"):
        _, told = a465(verb, file, code=2)
        assert "plan.json: arm: is missing, and a plan with unit none needs it (plan again" in told
