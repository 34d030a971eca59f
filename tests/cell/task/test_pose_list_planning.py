"""Plans through lists of poses: clear, in order, for their cell, and executed in a task."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from arm.controller.unit import load_unit
from arm.errors import ImpossibleError
from arm.io.storage import data_file
from arm.plan_file import GripperStep, read_plan
from arm.robot.jaws import FINGERS, with_any_jaws
from arm.robot.model import load_a465
from arm.robot.shapes import Body, Cylinder
from arm.se3 import rot_x, transform
from cell.commands.plan_poses import plan_poses_step
from cell.commands.run import resume_plan
from cell.config.cell_file import read_cell
from cell.console import Console
from cell.files.reading import Reading
from cell.files.task import read_place
from cell.session.connection import WhichCell
from cell.task.plan_matches import check_plan
from plan.collision.world import World
from plan.program.grammar import require_grammar
from plan.scene import Scene
from plan.verify import move_scenes
from tasks.pose_list_files import CELL, CTU_DEG, DOWN, TURNED, planned, written
from tasks.small import small_scenes
from typed.command_line import a465, replace_in


def test_no_entry_has_the_name_of_the_way_back(tmp_path: Path) -> None:
    listed = written(tmp_path, [{"name": "q_start", "q_deg": CTU_DEG[1]}])
    _, told = a465("plan", CELL, listed, "-o", tmp_path / "p", "--back", code=2)
    assert "list.json: [0] = 'q_start': is where --back leads to" in told


def test_what_cannot_be_reached_or_is_in_the_way_names_its_entry(tmp_path: Path) -> None:
    good, far = {"q_deg": CTU_DEG[1]}, transform(rot_x(np.pi), (1.5, 0.0, 0.3)).tolist()
    inside = transform(TURNED, (0.4, 0.0, 0.002)).tolist()
    for entries, rule in (
        ([good, {"T_base_tool": far}], r"list.json: \[1\]: target 'pose 2' .* is out of reach"),
        ([{"T_base_tool": DOWN.tolist()}, {"T_base_tool": far}], r"\[1\]: target 'pose 2' .* is out of reach"),
        ([good, {"name": "low", "T_base_tool": inside}], r"\[1\]: target 'low': all .* solutions are too near"),
        ([{"T_base_tool": DOWN.tolist()}, {"name": "q", "q_deg": [0, -80, -80, 0, -20, 0]}], r"\[1\] \(q\): .*table"),
    ):  # fmt: skip
        with pytest.raises(ImpossibleError, match=rule) as caught:
            planned(written(tmp_path, entries))
        assert caught.value.data["entry"] == "[1]"
    _, told = a465("plan", CELL, written(tmp_path, [{"T_base_tool": far}]), "-o", tmp_path / "p", code=3)
    assert "is out of reach" in told
    assert "what would help" in told
    assert "cube" not in told
    across = [transform(rot_x(np.pi), (0.42, y, 0.2)).tolist() for y in (-0.2, 0.2)]
    stops = [{"T_base_tool": across[0]}, {"T_base_tool": across[1], "by": "line"}]
    _, told = a465("plan", CELL, written(tmp_path, stops), "-o", tmp_path / "p", code=3)
    assert told.count("is at its upper limit") == 1
    assert "raise the speed" not in told
    assert not (tmp_path / "p").exists()
    with pytest.raises(ImpossibleError, match="nothing moves"):
        planned(written(tmp_path, [{"q_deg": [-60, -40, -80, 0, -60, 0]}]))


def test_a_pose_of_the_finger_tips_as_one_of_the_flange_is_told(tmp_path: Path) -> None:
    T = [[1, 0, 0, 0.42], [0, -1, 0, 0.0], [0, 0, -1, 0.05], [0, 0, 0, 1]]
    for frame, told in (("flange", True), ("tool", False)):
        (tmp_path / "p.json").write_text(json.dumps({"entries": [{f"T_base_{frame}": T, "free": "rz"}]}))
        asked = "plan", CELL, tmp_path / "p.json", "--no-advice", "-o", tmp_path / "q.json"
        _, refused = a465(*asked, code=3 if told else 0)
        words = (
            "; the pose is of the flange, and the tool is 134 mm long: is it of the finger tips (frame tool)?"
        )
        assert (words in refused) == told


def test_lines_keep_the_clearance_of_transits(tmp_path: Path) -> None:
    """Nothing in such a list may touch, so a line that ends 7 mm above the table is refused, 11 mm are not."""
    for height, clear in ((0.007, False), (0.011, True)):
        low = transform(TURNED, (0.42, 0.0, height)).tolist()
        path = written(tmp_path, [{"name": "low", "T_base_tool": low, "approach_mm": 30, "retract_mm": 30}])
        if clear:
            assert min(m.clearance for m in planned(path).moves) >= 0.010
            continue
        with pytest.raises(ImpossibleError, match=r"\[0\]: .*'low'.*required: 10 mm"):
            planned(path)


def test_where_jaws_close_they_count_at_any_opening(tmp_path: Path) -> None:
    """A post between the open fingers: clear of them, not of where they may be."""
    cell = tmp_path / "scenes/cell.toml"
    small_scenes(tmp_path)
    post = '[[walls]]\nname = "pin"\nshape = "cylinder"\nradius_mm = 2\nlength_mm = 296\ncentre_mm = [420, 0, 148]\n'
    replace_in(cell, "[look]", post + "\n[look]")
    T = transform(TURNED, (0.42, 0.0, 0.282)).tolist()
    around = {"name": "around", "T_base_tool": T, "approach_mm": 40}
    replace_in(cell, "clearance_mm = 10", "clearance_mm = 5")
    plan = planned(written(tmp_path, [around]), place=cell)
    assert plan.steps[-1].name == "approach around"
    with pytest.raises(ImpossibleError, match=r"'around'.*finger"):
        planned(written(tmp_path, [{**around, "jaws": "close"}]), place=cell)


def test_jaws_rests_and_corners_come_in_the_order_of_the_list(tmp_path: Path) -> None:
    aside = transform(TURNED, (0.42, 0.10, 0.30)).tolist()
    entries = [
        {"jaws": 0.3},
        {"name": "a", "T_base_tool": DOWN.tolist(), "approach_mm": 30, "jaws": "close", "dwell_s": 0.2},
        {"jaws": "open"},
        {"name": "b", "T_base_tool": aside, "by": "line", "speed_mm_s": 60, "retract_mm": 20},
        {"name": "c", "q_deg": CTU_DEG[1], "dwell_s": 0.3},
    ]
    plan = planned(written(tmp_path, entries), back=True)
    assert [s.name for s in plan.steps] == [
        "close at the start",
        "to a", "approach a", "close at a", "rest at a", "open at a",
        "line to b", "retract from b", "to c", "rest at c", "to q_start",
    ]  # fmt: skip
    jaws = [(s.action, s.fraction_closed) for s in plan.steps if isinstance(s, GripperStep)]
    assert jaws == [("close", 0.3), ("close", 1.0), ("open", 0.0)]
    openings = {s.name: s.jaw_opening for s in plan.moves}
    assert openings["to a"] == pytest.approx(0.7 * 0.06)
    assert openings["rest at a"] == 0.0
    assert openings["line to b"] == pytest.approx(0.06)
    rests = [s.path for s in plan.moves if s.name.startswith("rest")]
    assert [p.duration_s for p in rests] == pytest.approx([0.2, 0.3])
    assert all(p.end == p.start for p in rests)
    assert plan.task["cubes"] == []
    cell = read_cell(CELL)
    robot, path = cell.robot(), next(s for s in plan.moves if s.name == "line to b").path
    tool = np.array([robot.T_base_tool(q)[:3, 3] for q in cell.unit.positions(path.sample(0.01))])
    away = np.linalg.norm(np.cross(tool - DOWN[:3, 3], (0.0, 1.0, 0.0)), axis=1)
    assert away.max() < 2e-4
    speed = np.linalg.norm(np.diff(tool, axis=0), axis=1).max() / 0.01
    assert 0.05 < speed < 0.0605
    check_plan(read_place(CELL), plan)


def test_any_jaws_hold_what_every_opening_holds() -> None:
    """Never further from anything than the arm with its jaws anywhere."""
    unit, rng = load_unit("crs93"), np.random.default_rng(2)
    wide = with_any_jaws(load_a465(0.134112, 0.06))
    again = with_any_jaws(wide)
    assert [b.shape for b in again.bodies] == [b.shape for b in wide.bodies]
    pole = Body("pole", Cylinder(0.004, 0.4), transform(t=(0.4, 0.0, 0.2)), "post")
    fingers = [frozenset((name, "pole")) for name in FINGERS]
    closer = 0
    for q in rng.uniform(unit.lower, unit.upper, size=(30, 6)):
        world = World(wide, [pole])
        index = [i for i in range(len(world.pairs)) if frozenset(world.pair_names(i)) in fingers]
        ours = world.pair_distances(q, np.array(index))
        for opening in (0.0, 0.02, 0.06):
            other = World(load_a465(0.134112, opening), [pole])
            theirs = other.pair_distances(q, np.array(index))
            assert np.all(ours <= theirs + 1e-6)
            closer += bool(np.any(ours < theirs - 1e-3))
    assert closer > 10


def test_after_jaws_closed_for_no_cube_a_plan_is_judged_with_jaws_anywhere(tmp_path: Path) -> None:
    plan = planned(written(tmp_path, [{"q_deg": CTU_DEG[0], "jaws": "close"}, {"q_deg": CTU_DEG[1]}]))
    cell = read_cell(CELL)
    scene = Scene(cell.robot(), cell.robot(0.04), cell.fixed, ())
    before, after = (world.robot for _, world, _ in move_scenes(plan, scene, cell.unit))
    assert before.digest == cell.robot().digest
    assert after.digest == with_any_jaws(cell.robot()).digest
    require_grammar(plan)
    tampered = [
        replace(s, action="open") if isinstance(s, GripperStep) else s for s in plan.steps
    ]  # else it would be judged with open jaws
    with pytest.raises(ImpossibleError, match="says open but closes by 1"):
        require_grammar(replace(plan, steps=tuple(tampered)))


def test_a_plan_through_poses_is_for_the_cell_that_it_was_made_in(tmp_path: Path) -> None:
    small_scenes(tmp_path)
    cell, poses = tmp_path / "scenes/cell.toml", written(tmp_path, [{"q_deg": CTU_DEG[1]}])
    a465("plan", cell, poses, "-o", tmp_path / "p.json")
    a465("check", tmp_path / "p.json", cell)
    _, told = a465("check", tmp_path / "p.json", tmp_path / "scenes/task2.toml", code=3)
    assert "the plan is for task cell (poses), but task2.toml is of task task2" in told
    replace_in(cell, "clearance_mm = 10", "clearance_mm = 9")
    _, told = a465("check", tmp_path / "p.json", cell, code=3)
    assert "motion.clearance_mm 10, now 9" in told


def test_less_clearance_than_usual_is_asked_for_by_name_and_shown(tmp_path: Path) -> None:
    """In the cell file; the table, the page and the plan itself say so."""
    small_scenes(tmp_path)
    cell, poses = tmp_path / "scenes/cell.toml", written(tmp_path, [{"q_deg": CTU_DEG[1]}])
    replace_in(cell, "clearance_mm = 10", "clearance_mm = 3")
    _, told = a465("plan", cell, poses, "-o", tmp_path / "p.json", code=2)
    assert "motion.clearance_mm = 3: must be a number in mm from 5 to 100" in told
    assert "motion.least_clearance_mm" in told
    replace_in(cell, "clearance_mm = 3", "least_clearance_mm = 3.5\nclearance_mm = 3")
    _, told = a465("plan", cell, poses, "-o", tmp_path / "p.json", code=2)
    assert "must be a number in mm from 3.5 to 100" in told
    replace_in(cell, "least_clearance_mm = 3.5", "least_clearance_mm = 3")
    told, _ = a465("plan", cell, poses, "-o", tmp_path / "p.json")
    line = "planned with only 3 mm of clearance, as least_clearance allows; the usual minimum is 5 mm"
    assert f"NOTE: {line}" in told
    options = read_plan(tmp_path / "p.json").provenance["options"]
    assert (options["clearance"], options["least_clearance"]) == (0.003, 0.003)
    a465("preview", tmp_path / "p.json", cell, "-o", tmp_path / "p.html")
    assert line in (tmp_path / "p.html").read_text()
    a465("check", tmp_path / "p.json", cell)
    replace_in(cell, "least_clearance_mm = 3\nclearance_mm = 3", "clearance_mm = 10")
    told, _ = a465("plan", cell, poses, "-o", tmp_path / "q.json")
    assert "NOTE" not in told


@pytest.mark.slow
def test_a_plan_through_poses_is_executed_in_its_task(tmp_path: Path) -> None:
    """With a look, so that boards and cubes are in it; without one, the boards that are seen refuse it."""
    scenes = small_scenes(tmp_path)
    task, world = scenes / "task2.toml", scenes / "task2.world.toml"
    entries = [
        {"q_deg": CTU_DEG[0], "jaws": "close", "dwell_s": 0.2},
        {"T_base_tool": DOWN.tolist(), "free": "rz"},
    ]
    poses = written(tmp_path, entries)
    a465("look", task, "-o", tmp_path / "look.json")
    said, _ = a465("plan", task, poses, "--look", tmp_path / "look.json", "-o", tmp_path / "p.json")
    assert "only the table and the walls" not in said
    assert "objects in the jaws are unknown" in said
    plan = read_plan(tmp_path / "p.json")
    assert {b["kind"] for b in plan.scene["bodies"]} == {"table", "wall", "board", "stand"}
    assert len(plan.scene["cubes"]) == 4
    said, _ = a465("check", tmp_path / "p.json", task)
    assert "moves verified" in said
    said, _ = a465(
        "execute", tmp_path / "p.json", task, "--world", world, "--time-scale", 60, "--json", cwd=tmp_path
    )
    report = json.loads(said)
    assert report["plan_sha256"] == plan.sha256
    assert report["motion_s"] == pytest.approx(plan.duration_s, abs=1e-3)
    wire = (tmp_path / report["folder"] / "wire.jsonl").read_text()
    sent = "".join(r["data"] for r in map(json.loads, wire.splitlines()) if r.get("kind") == "sent")
    assert "COORDSPLINET:200" in sent  # the rest
    seen = json.loads(a465("export", tmp_path / report["folder"] / "wire.jsonl", "--json", cwd=tmp_path)[0])
    rows = (tmp_path / seen["file"]).read_text().splitlines()
    last = np.array([float(v) for v in rows[-1].split(",")[3:9]])
    reached = np.degrees(plan.task["poses"][-1]["q"])
    assert np.abs(last - reached).max() < 0.05
    with pytest.raises(ImpossibleError, match="moves no cubes, so its remaining part is unknown"):
        resume_plan(tmp_path / "p.json", task, Console(as_json=True), WhichCell("/dev/null"))
    a465("plan", task, poses, "-o", tmp_path / "blind.json")
    _, told = a465(
        "execute", tmp_path / "blind.json", task, "--world", world, "--time-scale", 60, code=3, cwd=tmp_path
    )
    assert "plate 01-02 is not in the plan" in told


def test_in_a_calibrated_cell_every_move_keeps_clearance_with_errors(tmp_path: Path) -> None:
    scenes = Path(shutil.copytree(data_file("scenes"), tmp_path / "scenes"))
    poses = tmp_path / "poses.json"
    poses.write_text(json.dumps([{"q_deg": degrees} for degrees in CTU_DEG[:2]]))
    cell = scenes / "realistic" / "cell.toml"
    asked = poses, None, tmp_path / "plan.json", Reading(), None, True, Console()
    said = plan_poses_step(cell, *asked)
    for move in said["moves"]:
        assert 0.1 < move["clearance_mm"] - move["clearance_with_errors_mm"] < 3.0
    assert all(m["clearance_with_errors_mm"] is None for m in plan_poses_step(CELL, *asked)["moves"])
    with cell.open("a") as file:
        file.write("\n[accuracy]\nleast_clearance_mm = 100\n")
    (tmp_path / "plan.json").unlink()
    with pytest.raises(ImpossibleError, match="for all errors of the arm within 3 standard deviations"):
        plan_poses_step(cell, *asked)
    assert not (tmp_path / "plan.json").exists()


@pytest.mark.parametrize(
    ("asked", "words"),
    [
        ((CELL,), "cell.toml is no task and no program; a list of poses has to follow it: a465 plan "),
        ((CELL.with_name("task2.toml"), "--back"), "--back is for a list of poses, and none is given"),
        ((CELL.with_name("hoop") / "b.toml", "--frame", "tool"), "--frame is for a list of poses"),
        ((CELL.with_name("task2.toml"), "--lengths", "m"), "--lengths is for a list of poses"),
    ],
)
def test_what_is_for_lists_needs_one(asked: tuple[Path | str, ...], words: str, tmp_path: Path) -> None:
    _, told = a465("plan", *asked, "-o", tmp_path / "p.json", code=2)
    assert words in told
    assert not (tmp_path / "p.json").exists()


def test_a_frame_is_of_the_poses_among_joint_angles(tmp_path: Path) -> None:
    q_deg = [0, -10, -90, 0, -70, 0]
    T = read_cell(CELL).robot().T_base_tool(np.radians(q_deg) + [0.1, 0, 0, 0, 0, 0])
    (tmp_path / "poses.json").write_text(json.dumps([{"q_deg": q_deg}, T.ravel().tolist()]))
    asked = "--frame", "tool", "-o", tmp_path / "plan.json"
    said, _ = a465("plan", CELL, tmp_path / "poses.json", *asked)
    assert "2 entries" in said


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("poses.csv", "x,y,z,roll,pitch,yaw\n0.42,0.0,0.30,3.1,0,0\n"),
        ("poses.json", '[{"q_deg": [0, -10, -90, 0, -70, 0]}, {"jaws": "open"}]'),
    ],
)
def test_a_frame_without_any_pose_is_refused(tmp_path: Path, name: str, text: str) -> None:
    (tmp_path / name).write_text(text)
    asked = "--angles", "rad", "-o", tmp_path / "plan.json"
    _, told = a465("plan", CELL, tmp_path / name, "--frame", "tool", *asked, code=2)
    rule = "has joint angles only; x y z roll pitch yaw is not read: give a pose as 12 or 16 numbers a row"
    assert told.splitlines() == [
        f"a465: wrong input: --frame tool: is of poses, and {tmp_path / name} {rule}"
    ]
    assert not (tmp_path / "plan.json").exists()


def test_six_numbers_of_a_pose_are_told_with_the_frame_that_was_given(tmp_path: Path) -> None:
    (tmp_path / "p.csv").write_text("0.42,0,0.25,3.14,0,0\n")
    for options, told in ((("--frame", "tool"), True), ((), False)):
        refused = a465("plan", CELL, tmp_path / "p.csv", *options, "-o", tmp_path / "q.json", code=2)[1]
        assert (
            "is no pose: a pose is 12 or 16 numbers, and x y z roll pitch yaw is not read" in refused
        ) == told
