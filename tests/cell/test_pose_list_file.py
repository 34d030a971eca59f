"""Lists of poses as programs for this arm have them: read without guessing, planned with proof, or refused by entry."""

from __future__ import annotations

import json
import re
import shlex
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from arm.bodies import Body, Cylinder
from arm.errors import FileInputError, ImpossibleError
from arm.files import data_file
from arm.jaws import FINGERS, with_any_jaws
from arm.planfile import GripperStep, Plan, read_plan
from arm.robot import load_a465
from arm.se3 import angle_between, rot_x, rot_z, transform
from arm.unit import load_unit
from cell.cellfile import read_cell
from cell.checking import check_plan
from cell.connection import WhichCell
from cell.console import Console
from cell.placefile import read_place
from cell.poselistfile import MOST, PoseList, Reading, read_pose_list
from cell.poselistplan import plan_pose_list
from cell.run import resume_plan
from command_line import a465, replace_in
from plan.replay import settings
from plan.scene import Scene
from plan.shape import require_shape
from plan.world import World
from small_scenes import small_scenes

CELL = data_file("scenes/cell.toml")
PAGE = Path(__file__).resolve().parents[2] / "docs/interop.md"
CTU_DEG = ([-30, -20, -90, 0, -60, 10], [0, -10, -90, 0, -70, 0], [30, -15, -95, 0, -65, -20])
TURNED = rot_x(np.pi) @ rot_z(0.6)  # the tool down, its jaws aslant
DOWN = transform(TURNED, (0.42, 0.0, 0.30))
FLANGE = Reading(frame="flange", angles="rad")


def written(folder: Path, content: Any, name: str = "list.json") -> Path:
    path = folder / name
    path.write_text(content if isinstance(content, str) else json.dumps(content))
    return path


def planned(path: Path, back: bool = False, reading: Reading | None = None, place: Path = CELL) -> Plan:
    return plan_pose_list(read_place(place), None, read_pose_list(path, reading), 1.0, back)


def ctu_crs_poses(configurations: list[list[float]]) -> np.ndarray:
    """Its forward kinematics, (n, 4, 4); in a process of its own, as it loads a camera's libraries."""
    code = (
        "import json, sys; from ctu_crs import CRS93; robot = CRS93(tty_dev=None); "
        "print(json.dumps([robot.fk(q).tolist() for q in json.loads(sys.argv[1])]))"
    )
    ran = subprocess.run(
        [sys.executable, "-c", code, json.dumps(configurations)], capture_output=True, text=True, check=True
    )
    return np.array(json.loads(ran.stdout))


def test_poses_of_ctu_crs_are_reached_to_a_count(tmp_path: Path) -> None:
    """Its forward kinematics gives the list; what our arm reaches is put into it again."""
    poses = ctu_crs_poses(np.radians(CTU_DEG).tolist())
    np.save(tmp_path / "poses.npy", poses)
    plan = planned(tmp_path / "poses.npy", reading=Reading(frame="flange"))
    again = ctu_crs_poses([reached["q"] for reached in plan.task["poses"]])
    for T, wanted in zip(again, poses, strict=True):
        assert np.abs(T[:3, 3] - wanted[:3, 3]).max() < 1e-4
        assert angle_between(T[:3, :3], wanted[:3, :3]) < 2e-4
    assert [move.name for move in plan.moves] == ["to pose 1", "to pose 2", "to pose 3"]
    assert all(m.certified and m.clearance >= 0.010 and m.role == "transit" for m in plan.moves)
    check_plan(read_place(CELL), plan)


def same(a: PoseList, b: PoseList) -> bool:
    return len(a.entries) == len(b.entries) and all(
        (x.frame, x.name) == (y.frame, y.name)
        and np.allclose(x.T if x.q is None else x.q, y.T if y.q is None else y.q, rtol=0.0, atol=1e-9)
        for x, y in zip(a.entries, b.entries, strict=True)
    )


def test_json_npy_and_csv_of_the_same_poses_are_the_same_list(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    poses = [transform(rot_x(a), t) for a, t in zip(rng.normal(size=5), rng.normal(size=(5, 3)), strict=True)]
    stack = np.array(poses)
    wanted = read_pose_list(written(tmp_path, {"frame": "flange", "entries": [T.tolist() for T in poses]}))
    assert [e.frame for e in wanted.entries] == ["flange"] * 5
    assert np.array_equal([e.T for e in wanted.entries], stack) or same(wanted, wanted)
    assert np.abs(np.array([e.T for e in wanted.entries]) - stack).max() < 1e-12
    for array in (stack, stack.reshape(5, 16), stack[:, :3], stack[:, :3].reshape(5, 12)):
        np.save(tmp_path / "poses.npy", array)
        assert same(read_pose_list(tmp_path / "poses.npy", FLANGE), wanted)
        listed = written(tmp_path, array.tolist(), "bare.json")
        assert same(read_pose_list(listed, FLANGE), wanted)
        rows = array.reshape(5, -1).tolist()
        text = "a,b,c\n# poses\n\n" + "\n".join("; ".join(map(repr, row)) for row in rows)
        assert same(read_pose_list(written(tmp_path, text, "p.csv"), FLANGE), wanted)
    keyed = [{"T_base_flange": T.ravel().tolist()} for T in poses]
    assert same(read_pose_list(written(tmp_path, keyed)), wanted)
    mm = stack.copy()
    mm[:, :3, 3] *= 1e3
    np.save(tmp_path / "mm.npy", mm)
    assert same(read_pose_list(tmp_path / "mm.npy", replace(FLANGE, lengths="mm")), wanted)
    keyed = [{"T_base_flange": T.tolist()} for T in mm]
    assert same(read_pose_list(written(tmp_path, {"lengths": "mm", "entries": keyed})), wanted)
    np.save(tmp_path / "one.npy", stack[0])
    assert len(read_pose_list(tmp_path / "one.npy", FLANGE).entries) == 1


def test_angles_are_what_is_said_of_them(tmp_path: Path) -> None:
    radians = np.radians(CTU_DEG)
    wanted = read_pose_list(written(tmp_path, {"angles": "deg", "entries": list(CTU_DEG)}), FLANGE)
    assert np.abs(np.array([e.q for e in wanted.entries]) - radians).max() < 1e-12
    np.save(tmp_path / "q.npy", radians)
    assert same(read_pose_list(tmp_path / "q.npy", FLANGE), wanted)
    for key, rows in (("q_rad", radians.tolist()), ("q_deg", list(CTU_DEG))):
        keyed = read_pose_list(written(tmp_path, [{key: row} for row in rows]))
        assert np.abs(np.array([e.q for e in keyed.entries]) - radians).max() < 1e-12


def test_everything_an_entry_may_say(tmp_path: Path) -> None:
    entry = {
        "name": "a", "T_base_tool": DOWN.tolist(), "by": "line", "free": "rz", "approach_mm": 10, "retract_mm": 20,
        "within_mm": 2, "speed_mm_s": 50, "dwell_s": 0.5, "jaws": 0.25,
    }  # fmt: skip
    found = read_pose_list(written(tmp_path, [entry, {"jaws": "close", "dwell_s": 1}])).entries
    a = found[0]
    assert (a.key, a.name, a.frame, a.by, a.free) == ("[0]", "a", "tool", "line", "rz")
    numbers = (a.approach, a.retract, a.within, a.speed, a.dwell_s, a.jaws)
    assert numbers == pytest.approx((0.01, 0.02, 0.002, 0.05, 0.5, 0.25))
    assert (found[1].T, found[1].q, found[1].jaws, found[1].dwell_s) == (None, None, 1.0, 1.0)


POSE = DOWN.ravel().tolist()
Q = [0.0, -0.2, -1.5, 0.0, -1.2, 0.0]
WRONG = [
    ([], "has no pose and no configuration"),
    ([POSE], r"\[0\]: is a pose, and nothing says whose; give --frame flange"),
    ([Q], r"\[0\]: is six joint angles, and nothing says in what unit; give --angles"),
    ({"frame": "wrist", "entries": [POSE]}, "frame = 'wrist': must be one of flange, tool"),
    ({"angles": "grad", "entries": [Q]}, "angles = 'grad': must be one of rad, deg"),
    ({"entires": [POSE]}, "entires.*: is not a key that is known here"),
    ({"frame": "tool"}, "entries: is missing"),
    ({"frame": "tool", "entries": [POSE, POSE[:15]]}, r"entries\[1\] = '15 numbers': must be one of 6"),
    ({"frame": "tool", "entries": [POSE, "pose"]}, r"entries\[1\] = 'pose': must be an object"),
    ({"frame": "tool", "entries": [[*POSE[:3], 500.0, *POSE[4:]]]}, r"entries\[0\].*in m; must be within 5 m.*mm"),
    ({"frame": "tool", "entries": [[*POSE[:4], 0.5, *POSE[5:]]]}, r"entries\[0\].*is no pose.*not a rotation"),
    ({"frame": "tool", "entries": [[*POSE[:12], 0, 0, 1, 1]]}, r"entries\[0\].*is no pose.*last row"),
    ({"frame": "tool", "entries": [[*POSE[:5], None, *POSE[6:]]]}, r"entries\[0\].*finite numbers"),
    ([{"T_base_tool": POSE, "q_rad": Q}], r"\[0\].q_rad.*: stands beside T_base_tool"),
    ([{"name": "a"}], r"\[0\]: must have one of T_base_flange"),
    ([{"q_rad": Q[:5]}], r"\[0\].q_rad: must be 6 numbers, not 5"),
    ([{"T_base_tool": [Q, Q]}], r"\[0\].T_base_tool: must be 4 \(or 3\) rows"),
    ([{"q_rad": Q, "by": "line"}], r"\[0\].by = 'line': goes with a pose only"),
    ([{"jaws": 1, "free": "rz"}], r"\[0\].free = 'rz': goes with a pose only"),
    ([{"T_base_tool": POSE, "by": "arc"}], r"\[0\].by = 'arc': must be one of transit, line"),
    ([{"T_base_tool": POSE, "approach_mm": -1}], r"\[0\].approach_mm = -1: must be a number from 0"),
    ([{"T_base_tool": POSE, "speed_mm_s": 0}], r"\[0\].speed_mm_s = 0: must be a number from 0.1"),
    ([{"T_base_tool": POSE, "dwell_s": True}], r"\[0\].dwell_s = True: must be a number"),
    ([{"T_base_tool": POSE, "jaws": 1.5}], r"\[0\].jaws = 1.5: must be open, close, or a number"),
    ([{"T_base_tool": POSE, "jaws": "shut"}], r"\[0\].jaws = 'shut': must be one of open, close"),
    ([{"T_base_tool": POSE, "pause": 1}], r"\[0\].pause = 1: is not a key that is known here"),
    ([{"name": "a", "q_rad": Q}, {"name": "a", "q_rad": Q}], r"\[1\] = 'a': has the name of \[0\]"),
    ([{"T_base_tool": POSE, "free": "rq"}], r"\[0\].*free = 'rq': must be of x, y"),
    ([{"q_deg": [0, 0, -45, 0, -45, 0]}, {"q_rad": [9, 0, 0, 0, 0, 0]}], r"\[1\] = .*J1 must be from"),
    ("1,2,3\n", r"row 1 = '3 numbers': must be one of 6"),
    ("x,y\n\n1 2 3 4 5 six\n", r"row 3 = 'six': must be a number"),
    ("1 2 3 4 5 nan\n", r"row 1.*: must be finite numbers"),
    ("just words\n", "has no pose and no configuration"),
    ("{", "is not JSON"),
]  # fmt: skip


@pytest.mark.parametrize(("content", "rule"), WRONG, ids=range(len(WRONG)))
def test_what_is_wrong_is_told_with_its_place(content: Any, rule: str, tmp_path: Path) -> None:
    path = written(tmp_path, content)
    with pytest.raises(FileInputError, match=rule) as caught:
        planned(path)
    assert str(caught.value).startswith(str(path))
    assert caught.value.exit_code == 2


def test_arrays_that_are_no_list_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "poses.npy"
    for array, rule in (
        (np.zeros((2, 5)), "row 1 = '5 numbers'"),
        (np.zeros((2, 2, 2, 2)), "must be an array of"),
        (np.array(["a"]), "array of real numbers"),
        (np.zeros((1, 6), dtype=complex), "array of real numbers"),
        (np.array(1.0), "must be an array of"),
        (np.zeros((0, 16)), "has no pose"),
    ):
        np.save(path, array)
        with pytest.raises(FileInputError, match=rule):
            read_pose_list(path, FLANGE)
    np.save(path, np.array([{"a": 1}], dtype=object), allow_pickle=True)
    with pytest.raises(FileInputError, match=r"is no \.npy file of numbers"):
        read_pose_list(path, FLANGE)
    path.write_bytes(path.read_bytes()[:20])
    with pytest.raises(FileInputError, match=r"is no \.npy file of numbers"):
        read_pose_list(path, FLANGE)
    path.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(FileInputError, match="is neither text"):
        read_pose_list(path, FLANGE)
    with pytest.raises(FileInputError, match="cannot be read"):
        read_pose_list(tmp_path, FLANGE)


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
    _, told = a465(
        "plan-poses", CELL, written(tmp_path, [{"T_base_tool": far}]), "-o", tmp_path / "p", code=3
    )
    assert "is out of reach" in told
    assert not (tmp_path / "p").exists()
    with pytest.raises(ImpossibleError, match="nothing moves"):
        planned(written(tmp_path, [{"q_deg": [-60, -40, -80, 0, -60, 0]}]))


def test_lines_keep_the_clearance_of_transits(tmp_path: Path) -> None:
    """Nothing in such a list may touch, so a line that ends 7 mm above the table is refused, 11 mm are not."""
    for height, clear in ((0.007, False), (0.011, True)):
        low = transform(TURNED, (0.42, 0.0, height)).tolist()
        path = written(tmp_path, [{"name": "low", "T_base_tool": low, "approach_mm": 30, "retract_mm": 30}])
        if clear:
            assert min(m.clearance for m in planned(path).moves) >= 0.010
            continue
        with pytest.raises(ImpossibleError, match=r"\[0\]: .*'low'.*asked: 10 mm"):
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
    assert plan.steps[-1].name == "approach to around"
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
        "to a", "approach to a", "close at a", "rest at a", "open at a",
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
    before, after = (setting.world.robot for _, setting in settings(plan, scene, cell.unit))
    assert before.digest == cell.robot().digest
    assert after.digest == with_any_jaws(cell.robot()).digest
    require_shape(plan)
    tampered = [
        replace(s, action="open") if isinstance(s, GripperStep) else s for s in plan.steps
    ]  # else it would be judged with open jaws
    with pytest.raises(ImpossibleError, match="says open but closes by 1"):
        require_shape(replace(plan, steps=tuple(tampered)))


def test_a_plan_through_poses_is_for_the_cell_that_it_was_made_in(tmp_path: Path) -> None:
    small_scenes(tmp_path)
    cell, poses = tmp_path / "scenes/cell.toml", written(tmp_path, [{"q_deg": CTU_DEG[1]}])
    a465("plan-poses", cell, poses, "-o", tmp_path / "p.json")
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
    _, told = a465("plan-poses", cell, poses, "-o", tmp_path / "p.json", code=2)
    assert "motion.clearance_mm = 3: must be a number in mm from 5 to 100" in told
    assert "motion.least_clearance_mm" in told
    replace_in(cell, "clearance_mm = 3", "least_clearance_mm = 3.5\nclearance_mm = 3")
    _, told = a465("plan-poses", cell, poses, "-o", tmp_path / "p.json", code=2)
    assert "must be a number in mm from 3.5 to 100" in told
    replace_in(cell, "least_clearance_mm = 3.5", "least_clearance_mm = 3")
    told, _ = a465("plan-poses", cell, poses, "-o", tmp_path / "p.json")
    line = "asked for 3 mm of clearance only, by name (least_clearance); the usual least is 5 mm"
    assert f"NOTE: {line}" in told
    options = read_plan(tmp_path / "p.json").provenance["options"]
    assert (options["clearance"], options["least_clearance"]) == (0.003, 0.003)
    a465("preview", tmp_path / "p.json", cell, "-o", tmp_path / "p.html")
    assert line in (tmp_path / "p.html").read_text()
    a465("check", tmp_path / "p.json", cell)
    replace_in(cell, "least_clearance_mm = 3\nclearance_mm = 3", "clearance_mm = 10")
    told, _ = a465("plan-poses", cell, poses, "-o", tmp_path / "q.json")
    assert "NOTE" not in told


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
    said, _ = a465("plan-poses", task, poses, "--look", tmp_path / "look.json", "-o", tmp_path / "p.json")
    assert "boards and cubes are not in this plan" not in said
    assert "what the jaws hold is not known" in said
    plan = read_plan(tmp_path / "p.json")
    assert {b["kind"] for b in plan.scene["bodies"]} == {"table", "wall", "board", "stand"}
    assert len(plan.scene["cubes"]) == 4
    said, _ = a465("check", tmp_path / "p.json", task)
    assert "hold" in said
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
    with pytest.raises(ImpossibleError, match="moves no cubes, so nothing tells what of it is left"):
        resume_plan(tmp_path / "p.json", task, Console(as_json=True), WhichCell("/dev/null"))
    a465("plan-poses", task, poses, "-o", tmp_path / "blind.json")
    _, told = a465(
        "execute", tmp_path / "blind.json", task, "--world", world, "--time-scale", 60, code=3, cwd=tmp_path
    )
    assert "plate 01-02 is not in the plan" in told


def test_options_that_are_no_words_and_files_that_are_both(tmp_path: Path) -> None:
    poses = written(tmp_path, [{"q_deg": CTU_DEG[1]}])
    for option, value in (("--frame", "wrist"), ("--angles", "turns"), ("--lengths", "inch")):
        _, told = a465("plan-poses", CELL, poses, option, value, code=2)
        assert f"{option} {value}: must be one of" in told
    _, told = a465("plan-poses", CELL, poses, "-o", poses, code=2)
    assert "is read by this command" in told
    _, told = a465("plan-poses", data_file("scenes/fixtures/mesh.toml"), poses, code=2)
    assert "is missing" in told
    _, told = a465("plan-poses", CELL, poses, "--speed", "0", code=2)
    assert "speed" in told


def test_the_page(tmp_path: Path) -> None:
    """Every command of docs/interop.md, and every file that it shows, as they are printed."""
    small_scenes(tmp_path)
    text = PAGE.read_text()
    for name, body in re.findall(r"<!-- file: (\S+) -->\n```\w*\n(.*?)```", text, re.DOTALL):
        (tmp_path / name).write_text(body)
    code = re.search(r"```python\n(.*?)```", text, re.DOTALL)
    assert code is not None
    subprocess.run([sys.executable, "-c", code[1]], cwd=tmp_path, check=True)
    ran = 0
    for block in re.findall(r"```sh\n(.*?)```", text, re.DOTALL):
        for line in block.splitlines():
            words = shlex.split(line, comments=True)
            assert words[0] == "a465"
            a465(*words[1:], cwd=tmp_path)
            ran += 1
    assert ran >= 10
    urdf = (tmp_path / "task_description/cell.urdf").read_text()
    assert all(
        f'<link name="{n}">' in urdf for n in ("plate_01_02", "stand_03_04", "cube_01_02_4", "camera_post")
    )
    for made in re.findall(r"`(\w+\.(?:csv|mcap|html|trajectory\.json))`", text):
        assert (tmp_path / made).exists(), made


def test_a_list_without_end_is_refused_at_once(tmp_path: Path) -> None:
    many = np.tile(np.zeros(6), (MOST + 1, 1))
    np.save(tmp_path / "many.npy", many)
    (tmp_path / "many.csv").write_text("0,0,0,0,0,0\n" * (MOST + 1))
    (tmp_path / "many.json").write_text(json.dumps(many.tolist()))
    for name in ("many.npy", "many.csv", "many.json"):
        with pytest.raises(FileInputError, match=rf"{name}: has more than {MOST} entries"):
            read_pose_list(tmp_path / name, Reading(angles="rad"))
    with (tmp_path / "lying.npy").open("wb") as file:
        shape = {"descr": "<f8", "fortran_order": False, "shape": (10**12, 6)}
        np.lib.format.write_array_header_1_0(file, shape)
    with pytest.raises(FileInputError, match=r"lying\.npy: is no \.npy file of numbers"):
        read_pose_list(tmp_path / "lying.npy", Reading(angles="rad"))
