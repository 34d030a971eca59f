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

from arm.errors import FileInputError
from arm.io.storage import data_file
from arm.se3 import angle_between, rot_x, transform
from cell.files.pose_list import MOST, PoseList, read_pose_list
from cell.files.reading import Reading
from cell.files.task import read_place
from cell.task.plan_matches import check_plan
from tasks.pose_list_files import CELL, CTU_DEG, DOWN, FLANGE, planned, written
from tasks.small import small_scenes
from typed.command_line import a465

PAGE = Path(__file__).resolve().parents[3] / "docs/interop.md"


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
        quoted = "\n".join(",".join(f'"{value!r}"' for value in row) for row in rows)
        assert same(read_pose_list(written(tmp_path, f'"a","b"\n{quoted}', "p.csv"), FLANGE), wanted)
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
    ([], "must have at least one pose or configuration"),
    ([POSE], r"\[0\]: is a pose without a frame; give --frame flange"),
    ([Q], r"\[0\]: has six joint angles without a unit; give --angles"),
    ({"frame": "wrist", "entries": [POSE]}, "frame = 'wrist': must be one of flange, tool"),
    ({"angles": "grad", "entries": [Q]}, "angles = 'grad': must be one of rad, deg"),
    ({"entires": [POSE]}, "entries: is missing.*entires is not a known key: did you mean entries"),
    ({"frame": "tool"}, "entries: is missing"),
    ({"frame": "tool", "entries": [POSE, POSE[:15]]}, r"entries\[1\] = '15 numbers': must be one of 6"),
    ({"frame": "tool", "entries": [POSE, "pose"]}, r"entries\[1\] = 'pose': must be an object"),
    ({"frame": "tool", "entries": [[*POSE[:3], 500.0, *POSE[4:]]]}, r"entries\[0\].*in m; must be within 5 m.*mm"),
    ({"frame": "tool", "entries": [[*POSE[:4], 0.5, *POSE[5:]]]}, r"entries\[0\].*is not a pose.*not a rotation"),
    ({"frame": "tool", "entries": [[*POSE[:12], 0, 0, 1, 1]]}, r"entries\[0\].*is not a pose.*last row"),
    ({"frame": "tool", "entries": [[*POSE[:5], None, *POSE[6:]]]}, r"entries\[0\].*finite numbers"),
    ([{"T_base_tool": POSE, "q_rad": Q}], r"\[0\].q_rad.*: cannot be combined with T_base_tool"),
    ([{"name": "a"}], r"\[0\] = {'name': 'a'}: must have one of T_base_flange"),
    ([{"q_rad": Q[:5]}], r"\[0\].q_rad = .*: must be 6 numbers, not 5"),
    ([{"T_base_tool": [Q, Q]}], r"\[0\].T_base_tool = .*: must be 4 \(or 3\) rows"),
    ([{"q_rad": Q, "by": "line"}], r"\[0\].by = 'line': needs a pose"),
    ([{"T_base_tool": POSE, "ranges": {"rz": [0, 1]}}], r"\[0\]\.ranges\.rz.*must be one of x_mm"),
    ([{"T_base_tool": POSE, "ranges": {"rz_deg": [9, 1]}}], r"ranges\.rz_deg.*lowest value, then"),
    ([{"T_base_tool": POSE, "ranges": {"rz_deg": [9]}}], r"ranges\.rz_deg.*2 numbers in deg"),
    ([{"T_base_tool": POSE, "ranges": 3}], r"ranges = 3: must be an object"),
    ([{"T_base_tool": POSE, "tilt_deg": 91}], r"tilt_deg = 91: must be a number in deg from 0 to 90"),
    ([{"jaws": 1, "free": "rz"}], r"\[0\].free = 'rz': needs a pose"),
    ([{"T_base_tool": POSE, "by": "arc"}], r"\[0\].by = 'arc': must be one of transit, line"),
    ([{"T_base_tool": POSE, "approach_mm": -1}], r"\[0\].approach_mm = -1: must be a number in mm from 0"),
    ([{"T_base_tool": POSE, "speed_mm_s": 0}], r"\[0\].speed_mm_s = 0: must be a number in mm/s from 0.1"),
    ([{"T_base_tool": POSE, "dwell_s": True}], r"\[0\].dwell_s = True: must be a number"),
    ([{"T_base_tool": POSE, "jaws": 1.5}], r"\[0\].jaws = 1.5: must be open, close, or a number"),
    ([{"T_base_tool": POSE, "jaws": "shut"}], r"\[0\].jaws = 'shut': must be open, close, or a number"),
    ([{"T_base_tool": POSE, "pause": 1}], r"\[0\].pause = 1: is not a known key \(known: T_base_flange"),
    ([{"name": "a", "q_rad": Q}, {"name": "a", "q_rad": Q}], r"\[1\] = 'a': is also the name of \[0\]"),
    ([{"T_base_tool": POSE, "free": "rq"}], r"\[0\].*free = 'rq': must be one of x, y"),
    ([{"q_deg": [0, 0, -45, 0, -45, 0]}, {"q_rad": [9, 0, 0, 0, 0, 0]}], r"\[1\] = .*J1 must.*degrees read as rad"),
    ("1,2,3\n", r"row 1 = '3 numbers': must be one of 6"),
    ("x,y\n\n1 2 3 4 5 six\n", r"row 3 = 'six': must be a number"),
    ("-30,5;-20,0;-90,0;0;-60,0;10,0\n", r"row 1 = '-30,5;.*': has decimal commas: decimals have a point"),
    ("a;b\n0\t-0,5\t1\t2\t3\t4 # six\n", r"row 2 = .*: has decimal commas"),
    ('"0,5","1","2","3","4","5"\n', r"row 1 = .*: has decimal commas"),
    ('"1","2","3","4","5","six"\n', r"row 1 = 'six': must be a number"),
    ('time_s,J1_rad,J2_rad,step\n0.0,0.5,0.5,"go on"\n', "list.json: is a table of samples, as a465 export writes it"),
    ('"Time_s";"a"\n0;1\n', "is a table of samples, as a465 export writes it, and no list of poses"),
    ("1 2 3 4 5 nan\n", r"row 1.*: must be finite numbers"),
    ("just words\n", "must have at least one pose or configuration"),
    ("{", "is not JSON"),
]  # fmt: skip


@pytest.mark.parametrize(("content", "rule"), WRONG, ids=range(len(WRONG)))
def test_what_is_wrong_is_told_with_its_place(content: Any, rule: str, tmp_path: Path) -> None:
    path = written(tmp_path, content)
    with pytest.raises(FileInputError, match=rule) as caught:
        planned(path)
    assert str(caught.value).startswith(str(path))
    assert caught.value.exit_code == 2


@pytest.mark.parametrize(
    "row", ["1,0,0,0.3;0,-1,0,0;0,0,-1,1", "1,0,0,0;0,-1,0,0;0,0,-1,1", "1;0;0;0,0;-1;0;0;0;0;-1;1"]
)
def test_rows_of_a_matrix_between_semicolons_are_no_decimal_commas(tmp_path: Path, row: str) -> None:
    path = tmp_path / "poses.csv"
    path.write_text(row)
    if row.count(",") > 1:
        assert read_pose_list(path, FLANGE).entries[0].T is not None
    else:
        with pytest.raises(FileInputError, match="decimal commas"):
            read_pose_list(path, FLANGE)


def test_arrays_that_are_no_list_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "poses.npy"
    for array, rule in (
        (np.zeros((2, 5)), "row 1 = '5 numbers'"),
        (np.zeros((2, 2, 2, 2)), "must be an array of"),
        (np.array(["a"]), "array of real numbers"),
        (np.zeros((1, 6), dtype=complex), "array of real numbers"),
        (np.array(1.0), "must be an array of"),
        (np.zeros((0, 16)), "has no entries"),
    ):
        np.save(path, array)
        with pytest.raises(FileInputError, match=rule):
            read_pose_list(path, FLANGE)
    np.save(path, np.array([{"a": 1}], dtype=object), allow_pickle=True)
    with pytest.raises(FileInputError, match=r"is not a \.npy file of numbers"):
        read_pose_list(path, FLANGE)
    path.write_bytes(path.read_bytes()[:20])
    with pytest.raises(FileInputError, match=r"is not a \.npy file of numbers"):
        read_pose_list(path, FLANGE)
    path.write_bytes(b"\xfe\x00\xff")
    with pytest.raises(FileInputError, match="is neither text"):
        read_pose_list(path, FLANGE)
    with pytest.raises(FileInputError, match="is a folder, must be a file"):
        read_pose_list(tmp_path, FLANGE)


def test_options_that_are_no_words_and_files_that_are_both(tmp_path: Path) -> None:
    poses = written(tmp_path, [{"q_deg": CTU_DEG[1]}])
    for option, value in (("--frame", "wrist"), ("--angles", "turns"), ("--lengths", "inch")):
        _, told = a465("plan", CELL, poses, option, value, code=2)
        assert f"{option} {value}: must be one of" in told
    _, told = a465("plan", CELL, poses, "-o", poses, code=2)
    assert "is read by this command" in told
    _, told = a465("plan", data_file("scenes/fixtures/mesh.toml"), poses, code=2)
    assert "is a scene file, and a task, a program, a cell or an arm file belongs here" in told
    _, told = a465("plan", CELL, CELL, code=2)
    assert "is a cell file, and a list of poses belongs here" in told
    _, told = a465("plan", CELL, poses, "--speed", "0", code=2)
    assert "speed" in told


@pytest.mark.slow
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
    with pytest.raises(FileInputError, match=r"lying\.npy: is not a \.npy file of numbers"):
        read_pose_list(tmp_path / "lying.npy", Reading(angles="rad"))


def test_limits_of_directions_are_read_in_si(tmp_path: Path) -> None:
    path = tmp_path / "list.json"
    entry = {"T_base_tool": POSE, "tilt_deg": 20, "ranges": {"rz_deg": [-30, 60], "x_mm": [-10, 10]}}
    path.write_text(json.dumps([entry]))
    (read,) = read_pose_list(path).entries
    assert read.tilt == pytest.approx(np.radians(20))
    assert read.ranges == {"rz": pytest.approx((np.radians(-30), np.radians(60))), "x": (-0.01, 0.01)}


@pytest.mark.parametrize(
    ("header", "reading", "told"),
    [
        ("J1_rad,J2_rad,J3_rad,J4_rad,J5_rad,J6_rad", Reading(angles="deg"), r"row 1 = 'J1_rad': is in rad"),
        ("t_s,J1_deg,J2_deg,J3_deg,J4_deg,J5_deg", Reading(angles="rad"), r"give --angles deg"),
        ("x_mm,y_mm,z_mm,a,b,c", Reading(angles="deg"), r"is in mm by its name, but numbers are read in m"),
    ],
)
def test_columns_that_name_another_unit_are_refused(
    tmp_path: Path, header: str, reading: Reading, told: str
) -> None:
    file = tmp_path / "poses.csv"
    file.write_text(f"{header}\n0,-0.3,-1.5,0,-1,0\n")
    with pytest.raises(FileInputError, match=told):
        read_pose_list(file, reading)


@pytest.mark.parametrize(
    "header", ["J1_deg,J2_deg,J3_deg,J4_deg,J5_deg,J6_deg", "J1,J2,J3,J4,J5,J6", "a_b,,,,,"]
)
def test_columns_that_name_the_unit_or_none_are_passed_over(tmp_path: Path, header: str) -> None:
    file = tmp_path / "poses.csv"
    file.write_text(f"{header}\n0,-10,-90,0,-70,0\n")
    (entry,) = read_pose_list(file, Reading(angles="deg")).entries
    assert entry.q == pytest.approx(np.radians([0, -10, -90, 0, -70, 0]))


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("0\u00b0,1,2,3,4,5\n", r"row 1 = '0\u00b0': must be a number .write the number alone: 0"),
        ("home,0,-10,-90,0,-70,0\n", r"row 1 = 'home': must be a number .rows have numbers only; names stand in"),
        ("0,,-90,0,-70,0\n", r"row 1 = .*: has an empty cell; every cell must be a number"),
        ("1,0,-10,-90,0,-70,0\n", r"row 1 = '7 numbers': must be one of .*is its first number that of the row\?"),
        ("J1 (rad),J2 (rad),J3 (rad),J4 (rad),J5 (rad),J6 (rad)\n", r"'J1 \(rad\)': is in rad by its name, but"),
        ("J1,J2\nJ3,J4\n0,-10,-90,0,-70,0\n", r"row 2 = 'J3': must be a number"),
    ],
)  # fmt: skip
def test_what_a_row_has_that_is_no_number_is_told(tmp_path: Path, text: str, told: str) -> None:
    file = tmp_path / "q.csv"
    file.write_text(text)
    with pytest.raises(FileInputError, match=told):
        read_pose_list(file, Reading(angles="deg"))


def test_a_quaternion_and_columns_of_poses_are_told(tmp_path: Path) -> None:
    file = tmp_path / "q.csv"
    file.write_text("0.42,0,0.25,0,1,0,0\n")
    with pytest.raises(FileInputError, match=r"'7 numbers': .*x y z and a quaternion are not read"):
        read_pose_list(file, Reading(frame="tool"))
    np.save(tmp_path / "q.npy", np.zeros((6, 3)))
    with pytest.raises(
        FileInputError, match=r"\[6, 3\]: has a pose or configuration in each column; .*transpose"
    ):
        read_pose_list(tmp_path / "q.npy", Reading(angles="deg"))


@pytest.mark.parametrize(
    ("key", "value"), [("within_mm", 0.005), ("approach_mm", 0.04), ("ranges", {"x_mm": [-0.01, 0.01]})]
)
def test_lengths_of_an_entry_in_metres_are_told(tmp_path: Path, key: str, value: object) -> None:
    file = tmp_path / "q.json"
    file.write_text(json.dumps([{"T_base_tool": np.eye(4).tolist(), key: value}]))
    with pytest.raises(FileInputError, match=r"is it in metres\?"):
        read_pose_list(file)


def test_one_entry_without_its_list_is_told(tmp_path: Path) -> None:
    file = tmp_path / "q.json"
    file.write_text(json.dumps({"q_deg": [0, -10, -90, 0, -70, 0]}))
    with pytest.raises(
        FileInputError, match=r"q.json: is one entry, must be a list of entries .put it in \[ \]"
    ):
        read_pose_list(file)


@pytest.mark.parametrize(
    ("more", "told"),
    [
        ({"ranges": {"rz_deg": [-1.57, 1.57]}}, "[0].ranges.rz_deg = [-1.57, 1.57]: is it in rad? Then it"),
        ({"free": "rz", "tilt_deg": 0.26}, "[0].tilt_deg = 0.26: is it in rad? Then it must be 14.9 in deg"),
        ({"free": "rz", "speed_mm_s": 60}, '[0].speed_mm_s: has no effect without lines: give by = "line"'),
    ],
)  # fmt: skip
def test_angles_in_rad_and_speeds_without_lines_are_noted(
    tmp_path: Path, more: dict[str, Any], told: str
) -> None:
    file = tmp_path / "q.json"
    T = [[1, 0, 0, 0.42], [0, -1, 0, 0], [0, 0, -1, 0.25], [0, 0, 0, 1]]
    file.write_text(json.dumps([{"T_base_tool": T, **more}]))
    said = a465("plan", data_file("scenes/cell.toml"), file, "-o", tmp_path / "plan.json")[0]
    assert f"NOTE: q.json: {told}" in said.replace("\n", " ")


def test_angles_in_rows_are_told_to_be_one_list(tmp_path: Path) -> None:
    file = tmp_path / "q.json"
    file.write_text(json.dumps([{"q_deg": [[0, -10, -90, 0, -70, 0]]}]))
    with pytest.raises(FileInputError, match=r"\[0\].q_deg = .*: must be one list of numbers$"):
        read_pose_list(file)
