"""Plans of arms without a unit on the command line: checked, shown and exported from the file alone, never sent."""

from __future__ import annotations

import csv
import json
import re
import shutil
from pathlib import Path

import numpy as np
import pytest
from anyarm_bench.arms import ARMS, SHARE, load
from anyarm_bench.problems import draw

from arm.io.storage import data_file
from arm.plan_file import read_plan, write_plan
from cell.config.arm_file import read_arm_file
from cell.export.scene import surroundings_of_file, surroundings_of_plan
from cell.export.urdf import describe
from plan.program.planned import Planned
from plans.other_arms import OTHER_ARMS, OVERLAPPING, scara_files, seven_joints, six_joints
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
    assert "plan.json: unit = 'none': the plan is for an arm without a controller, and is never sent" in told
    for words in (("check", six, task), ("preview", six, task), ("export", six, "--cell", CELL)):
        _, told = a465(*words, code=2)
        assert f"plan.json: arm: is the plan's own, which needs no cell; leave out {words[-1]}" in told
    _, told = a465("preview", six, "--image", task, code=2)
    assert "--image goes with a plan of a cell; " in told


def test_what_is_missing_is_told_by_file_key_and_value(six: Path, tmp_path: Path) -> None:
    file = tmp_path / "plan.json"
    shutil.copy(six, file)
    replace_in(file, '"unit":"none"', '"unit":"crs93"')
    for verb in ("check", "preview"):
        _, told = a465(verb, file, code=2)
        assert "plan.json: task.name: must be the name of a task; give its task file too" in told
    replace_in(file, '"unit":"crs93"', '"unit":"none"')
    replace_in(file, '"arm":', '"robot":')
    for verb in ("check", "preview", "export"):
        _, told = a465(verb, file, code=2)
        assert "plan.json: arm: is missing, and a plan with unit none needs it (plan again" in told


def test_a_list_is_planned_from_an_arm_file(tmp_path: Path) -> None:
    file, plan = scara_files(tmp_path), tmp_path / "plan.json"
    said, _ = a465("plan", file, tmp_path / "poses.json", "-o", plan, "--speed", "1", "--back")
    assert "3 entries" in said
    read = read_plan(plan)
    assert (read.unit, read.speed, read.task["name"], read.task["kind"]) == ("none", 1.0, "scara", "poses")
    assert [pose["name"] for pose in read.task["poses"]] == ["aside", "fetch", "leave"]
    assert read.task["poses"][0]["q"] == pytest.approx([0.6, 0.7, 0.02, 0.0], abs=1e-6)
    assert list(read.moves)[-1].path.end == read.start
    assert any(move.name == "rest at fetch" and move.path.duration_s == 0.5 for move in read.moves)
    for words in (("check", plan, file), ("preview", plan, file), ("export", plan, "--cell", file)):
        a465(*words)
    replace_in(file, "tool_mm = [0, 0, 80]", "tool_mm = [0, 0, 81]")
    for words in (("check", plan, file), ("preview", plan, file), ("export", plan, "--cell", file)):
        _, told = a465(*words, code=3)
        assert "not for the arm of scara.toml: arm.tool_mm [0, 0, 80], now [0, 0, 81]; plan again" in told
    replace_in(file, "tool_mm = [0, 0, 81]", "tool_mm = [0, 0, 80]")
    replace_in(tmp_path / "scara.urdf", 'velocity="4"', 'velocity="3"')
    _, told = a465("check", plan, file, code=3)
    assert "not for the arm of scara.toml: the arm, its SRDF or its meshes; plan again" in told
    a465("check", plan)  # which holds for the arm that it states


@pytest.mark.slow
def test_seven_joints_with_a_gripper_from_an_arm_file(tmp_path: Path) -> None:
    seven_joints(tmp_path)
    pairs = json.dumps([list(pair) for pair in (*OVERLAPPING, *((f"l{k}", f"l{k + 1}") for k in range(7)))])
    (tmp_path / "seven.toml").write_text(
        "q_start = [-0.8, 0.0, 0.0, -1.9, 0.0, 1.9, 0.8]\n"
        '[arm]\nurdf = "gripper.urdf"\nend_frame = "hand"\ntool_mm = [0, 0, 80]\nacceleration = 4.0\n'
        f"locked = {{ left_slide = 0.03 }}\ndisabled_collisions = {pairs}\nneighbours_may_touch = true\n"
        '[[bodies]]\nname = "post"\nshape = "cylinder"\nradius_mm = 40\nlength_mm = 600\ncentre_mm = [500, 0, 260]\n'
    )
    there = {"T_base_flange": [1, 0, 0, 0.4, 0, -1, 0, 0.25, 0, 0, -1, 0.23], "free": "rz"}
    poses = [{"q_deg": [-40, 10, 0, -100, 0, 110, 45]}, there]
    (tmp_path / "list.json").write_text(json.dumps(poses))
    a465("plan", tmp_path / "seven.toml", tmp_path / "list.json", "-o", tmp_path / "plan.json")
    told = json.loads(a465("check", tmp_path / "plan.json", tmp_path / "seven.toml", "--json")[0])
    assert told["min_clearance_mm"] >= 10.0 - 1e-3
    arm = read_plan(tmp_path / "plan.json").arm["open"]
    assert arm["locked"] == {"left_slide": 0.03, "right_slide": 0.03}
    folder = tmp_path / "described"
    a465("export", tmp_path / "seven.toml", "-o", folder)
    there_now = surroundings_of_file(tmp_path / "seven.toml", None)
    require_read(there_now, describe(there_now).links, Exported(folder), seed=4)


def test_what_a_list_of_another_arm_cannot_have_is_told(six: Path, tmp_path: Path) -> None:
    file, listed = scara_files(tmp_path), tmp_path / "poses.json"
    text = listed.read_text()
    for old, new, told in (
        (
            '"q_rad": [0.6',
            '"q_deg": [0.6',
            "entries[0].q_deg = [0.6, 0.7, 0.02, 0.0]: must be in rad, and in m",
        ),
        ("0.02, 0.0]", "0.02]", "entries[0].q_rad = [0.6, 0.7, 0.02]: must be 4 numbers, not 3"),
        (
            "0.02, 0.0]",
            "0.2, 0.0]",
            "entries[0] = [0.6, 0.7, 0.2, 0.0]: in rad, m where a joint slides: j3 must be",
        ),
        ('"dwell_s": 0.5', '"jaws": "close"', "entries[1]: jaws: the arm of scara has no jaws that move"),
    ):
        listed.write_text(text.replace(old, new, 1))
        _, said = a465("plan", file, listed, code=2, cwd=tmp_path)
        assert f"poses.json: {told}" in said
    listed.write_text("0.1,0.2,0.3,0.4,0.5\n")
    _, said = a465("plan", file, listed, code=2, cwd=tmp_path)
    assert "row 1 = '5 numbers': must be one of 4 (joint positions), 12 (" in said
    _, said = a465("plan", file, listed, "--look", listed, code=2, cwd=tmp_path)
    assert "--look does not go with an arm file" in said
    for verb in ("check", "preview", "execute"):
        _, said = a465(verb, file, six, code=2)
        assert f"are swapped: the plan comes first, then its task; give a465 {verb} {six} {file}" in said
    _, said = a465("check", file, code=2)
    assert "scara.toml: is an arm file; check needs a plan made with it" in said
    _, said = a465("export", file, "--look", listed, code=2)
    assert "is an arm file, which already contains its bodies; leave out --look" in said


@pytest.mark.slow
@pytest.mark.parametrize("name", ARMS)
def test_arms_as_pip_installs_them(name: str, tmp_path: Path) -> None:
    """With the extra `bench`: URDF, SRDF and meshes as their packages ship them, planned from an arm file."""
    arm, file = ARMS[name], tmp_path / "arm.toml"
    if not (SHARE / arm.urdf).is_file():
        pytest.skip("no arms: pip install 'a465[bench]'")
    problem = draw(name, 2)
    locked = ", ".join(f"{joint} = {at}" for joint, at in arm.locked.items())
    file.write_text(
        f"q_start = {problem.q_start.tolist()}\nclearance_mm = 5\nspeed = 1\n[arm]\nacceleration = 4\n"
        f'urdf = "{SHARE / arm.urdf}"\nsrdf = "{SHARE / arm.srdf}"\nend_frame = "{arm.end_frame}"\n'
        f"tool_mm = [0, 0, {1e3 * arm.tool}]\nlocked = {{ {locked} }}\n"
    )
    assert read_arm_file(file).robot.digest == load(name)[0].digest
    entries = [{"T_base_tool": T.tolist()} for T in problem.poses]
    (tmp_path / "poses.json").write_text(json.dumps(entries))
    plan, folder = tmp_path / "plan.json", tmp_path / "described"
    a465("plan", file, tmp_path / "poses.json", "-o", plan)
    assert json.loads(a465("check", plan, file, "--json")[0])["min_clearance_mm"] >= 5.0 - 1e-3
    a465("preview", plan)
    a465("export", plan, "--format", "urdf", "-o", folder)
    there = surroundings_of_plan(plan, read_plan(plan), None)
    require_read(there, describe(there).links, Exported(folder), seed=5)
