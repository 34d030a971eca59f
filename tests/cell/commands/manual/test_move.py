"""From where the arm is to a goal of the command line: certified, seen, and reached to the count."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from arm.errors import FileInputError, ImpossibleError, InputError
from arm.plan_file import read_plan
from cell.commands.manual.move import Goal, goal_entry, move_step, read_goal
from cell.config.cell import Cell
from cell.config.cell_file import read_cell
from driver.emulator import Emulator
from emulated.stepped_cell import names_sent, stepped_cell
from typed.command_line import a465
from typed.heard import Heard

from .conftest import CELL

AT = (10.0, -20.0, -90.0, 0.0, -70.0, 0.0)
QUERIES = {"ECHO", "STAMP", "VER?", "ST?", *(f"AP{axis}?" for axis in "ABCDEFGH")}


def _tool(cell: Cell, emulator: Emulator) -> Any:
    return cell.robot().T_base_tool(cell.unit.positions(emulator.counts()))


def _move(goal: Goal, console: Heard | None = None) -> dict[str, Any]:
    return move_step(goal, CELL, "/dev/mars", None, 1.0, True, console or Heard())


def test_joint_angles_are_reached_to_the_count(here: Cell, monkeypatch: pytest.MonkeyPatch) -> None:
    with stepped_cell(here, monkeypatch, AT) as emulator:
        _move(Goal("q", (12.0, -18.0, -92.0, 3.0, -68.0, 5.0)))
        expected = here.unit.counts(np.radians([12.0, -18.0, -92.0, 3.0, -68.0, 5.0]))
        np.testing.assert_array_equal(emulator.counts(), expected)
        _move(Goal("turn", (-2.0, 0.0, 0.0, 0.0, 0.0, 1.0)))
        expected = here.unit.counts(np.radians([10.0, -18.0, -92.0, 3.0, -68.0, 6.0]))
        assert np.abs(np.subtract(emulator.counts(), expected)).max() <= 1
        assert emulator.violations == ()
    for folder in ("move-1", "move-2"):
        plan = read_plan(Path("runs") / folder / "plan.json")
        assert all(move.certified for move in plan.moves)
        assert (Path("runs") / folder / "preview.html").exists()


@pytest.mark.parametrize(
    ("goal", "shift_mm"),
    [
        (Goal("by", (0.0, 20.0, 30.0), line=True), (0.0, 20.0, 30.0)),
        (Goal("by", (0.0, 20.0, 30.0)), (0.0, 20.0, 30.0)),
        (Goal("along", (0.0, 0.0, -25.0), line=True), (0.0, 0.0, 25.0)),  # the tool points down
    ],
)
def test_the_tool_is_shifted_and_keeps_its_orientation(
    here: Cell, monkeypatch: pytest.MonkeyPatch, goal: Goal, shift_mm: tuple[float, ...]
) -> None:
    with stepped_cell(here, monkeypatch, AT) as emulator:
        before = _tool(here, emulator)
        assert before[2, 2] == pytest.approx(-1.0, abs=1e-3)
        _move(goal)
        after = _tool(here, emulator)
    np.testing.assert_allclose(1e3 * (after - before)[:3, 3], shift_mm, atol=0.05)
    np.testing.assert_allclose(after[:3, :3], before[:3, :3], atol=1e-4)


def test_a_position_and_a_taught_pose_are_reached(here: Cell, monkeypatch: pytest.MonkeyPatch) -> None:
    entries = [
        {"name": "tray", "q_deg": [14, -20, -90, 0, -70, 0], "jaws": "close", "dwell_s": 9},
        {"name": "rest", "jaws": 0.4},
    ]
    Path("poses.json").write_text(json.dumps({"entries": entries}))
    with stepped_cell(here, monkeypatch, AT) as emulator:
        _move(Goal("list", poses=Path("poses.json"), name="tray"))
        np.testing.assert_array_equal(
            emulator.counts(), here.unit.counts(np.radians([14, -20, -90, 0, -70, 0]))
        )
        assert not any(name == "GG" for name in names_sent(emulator)), "the jaws stay as they are"
        x, y, z = 1e3 * _tool(here, emulator)[:3, 3] + (5.0, -10.0, 15.0)
        _move(Goal("to", (x, y, z)))
        np.testing.assert_allclose(1e3 * _tool(here, emulator)[:3, 3], (x, y, z), atol=0.05)
        with pytest.raises(FileInputError, match="is no pose of the list; must be one of 'tray'"):
            _move(Goal("list", poses=Path("poses.json"), name="rest"))


def test_a_pose_that_was_taught_on_another_arm_is_told(here: Cell, monkeypatch: pytest.MonkeyPatch) -> None:
    record = {"unit": "crs97", "counts": [0] * 6, "T_base_tool": np.eye(4).tolist()}
    entries = [{"name": "tray", "q_deg": [14, -20, -90, 0, -70, 0], "taught": record}]
    Path("poses.json").write_text(json.dumps({"entries": entries}))
    words = "'tray' was taught on crs97, and this cell has crs93"
    console = Heard()
    with stepped_cell(here, monkeypatch, AT):
        _move(Goal("list", poses=Path("poses.json"), name="tray"), console)
    assert words in console.all
    said, _ = a465("plan", CELL, "poses.json", "-o", "plan.json")
    assert words in said


def test_the_errors_of_the_arm_count_with_half_open_jaws(
    scenes: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    place = scenes / "realistic/cell.toml"
    place.write_text(place.read_text() + "\n[accuracy]\nleast_clearance_mm = 50\n")
    strict = read_cell(place)
    with stepped_cell(strict, monkeypatch, (-57.0, -40.0, -80.0, 0.0, -60.0, 5.0)) as emulator:
        emulator.machine.jaws.slip(strict.unit.gripper.adc(strict.gripper.fraction_closed(0.02)))
        with pytest.raises(ImpossibleError, match="for all errors of the arm within"):
            move_step(Goal("turn", (3.0, *[0.0] * 5)), place, "/dev/mars", None, 1.0, True, Heard())
        assert set(names_sent(emulator)) <= QUERIES


def test_the_code_of_the_preview_lets_the_arm_go_and_nothing_else(
    here: Cell, monkeypatch: pytest.MonkeyPatch, answers: Callable[..., None]
) -> None:
    goal, sent = Goal("turn", (3.0, 0.0, 0.0, 0.0, 0.0, 0.0)), []
    with stepped_cell(here, monkeypatch, AT) as emulator:

        def answer() -> str:
            sent.append(set(names_sent(emulator)))
            found = re.search(r'"code": ?"(\w{4}-\w{4})"', Path("runs/move-2/preview.html").read_text())
            assert found is not None
            return found[1]

        answers(lambda: "AAAA-AAAA")
        with pytest.raises(InputError, match="was not confirmed with the code of its preview; nothing moved"):
            move_step(goal, CELL, "/dev/mars", None, None, False, Heard())
        answers(answer)
        move_step(goal, CELL, "/dev/mars", None, None, False, Heard())
        assert read_plan(Path("runs/move-2/plan.json")).speed == 0.2
        assert emulator.counts()[0] == here.unit.counts(np.radians([13.0, *AT[1:]]))[0]
    assert all(names <= QUERIES for names in sent)


def test_what_is_not_certified_is_refused_and_nothing_moves(
    here: Cell, monkeypatch: pytest.MonkeyPatch
) -> None:
    with stepped_cell(here, monkeypatch, AT) as emulator:
        x, y, _ = 1e3 * _tool(here, emulator)[:3, 3]
        with pytest.raises(ImpossibleError, match="with --look FILE only the boards that were seen do"):
            _move(Goal("to", (x, y, 100.0)))
        with pytest.raises(
            ImpossibleError, match=r"^--to=2000,0,300: the goal at .* is out of reach"
        ) as refused:
            _move(Goal("to", (2000.0, 0.0, 300.0)))
        assert "poses.json" not in str(refused.value)
        with pytest.raises(
            ImpossibleError,
            match=r"^--to=0\.42,0,0\.3 \(in mm: were metres meant\?\): the goal at .* is out of reach",
        ):
            _move(Goal("to", (0.42, 0.0, 0.3)))
        with pytest.raises(InputError, match=r"^--by=0,0,6000: leads the tool 6\d+ mm from the base; must"):
            _move(Goal("by", (0.0, 0.0, 6000.0)))
        beyond = r"^--turn=0,200,0,0,0,0: J2 would be at \d+\.\d deg, must be from \S+ to \S+ deg on crs93$"
        with pytest.raises(InputError, match=beyond):
            _move(Goal("turn", (0.0, 200.0, 0.0, 0.0, 0.0, 0.0)))
        assert set(names_sent(emulator)) <= QUERIES


def test_a_goal_as_an_entry_of_a_list(here: Cell) -> None:
    q = np.radians(AT)
    entry = goal_entry(Goal("along", (0.0, 0.0, 10.0), line=True), here, q)
    T = here.robot().T_base_tool(q)
    np.testing.assert_allclose(np.array(entry["T_base_tool"])[:3, 3], T[:3, 3] + 0.01 * T[:3, 2], atol=1e-12)
    assert entry["by"] == "line"
    assert "by" not in goal_entry(Goal("to", (1.0, 2.0, 3.0)), here, q)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ((), "give one goal of --q, --turn, --to, --by, --along, --list; given: none"),
        (("--q=0,0,0,0,0,0", "--by=0,0,1"), "given: --q, --by"),
        (("--q=0,0,0", "--unseen"), "--q=0,0,0: must be 6 numbers separated by commas, J1 to J6 in deg"),
        (("--by=0,0,x",), "must be 3 numbers separated by commas, x, y, z in mm"),
        (("--to=0,0,nan",), "must be 3 numbers"),
        (
            ("--q=0,0,0,0,200,0", "--unseen"),
            "--q=0,0,0,0,200,0: J5 must be from -104.0 to 103.9 deg on crs93",
        ),
        (("--turn=0,0,0,0,0,0", "--line"), "--line needs a tool position"),
        (("--list", "poses.json"), "--list LIST and --name NAME go together"),
        (("--name", "a"), "--name names an entry of a list; give --list LIST too"),
        (("--by=0,0,1", "--name", "a"), "--list LIST and --name NAME go together"),
        (("--by=0,0,1",), "no terminal to confirm that the arm may move: give --unseen"),
        (("--list", "/none/p.json", "--name", "a"), "p.json: cannot be read"),
        (
            ("--to=4200,0,5300",),
            "--to=4200,0,5300: leads the tool 5300 mm from the base; must be within 5000 mm",
        ),
    ],
)
def test_a_goal_that_is_wrong_is_refused_before_a_port_is_opened(
    options: tuple[str, ...], words: str, tmp_path: Path
) -> None:
    _, told = a465("move", CELL, "/dev/null", *options, code=2)
    assert words in told
    assert list(tmp_path.iterdir()) == []


def test_a_goal_is_read() -> None:
    none = dict.fromkeys(("q", "turn", "to", "by", "along"))
    assert read_goal({**none, "by": "0,-1.5,2"}, None, None, True) == Goal("by", (0.0, -1.5, 2.0), True)
    listed = read_goal(none, Path("a.json"), "b", False)
    assert (listed.kind, listed.poses, listed.name) == ("list", Path("a.json"), "b")


def test_joint_angles_that_may_be_in_rad_are_told_before_a_port_is_opened() -> None:
    for angles, told in (("-1.05,-0.7,-1.4,0,-1.05,0.1", True), ("-60,-40.5,-80,0,-60,0", False)):
        said, _ = a465("move", CELL, "/dev/none-such", f"--q={angles}", "--unseen", code=2)
        assert (
            "NOTE: --q [-1.05, -0.7, -1.4, 0, -1.05, 0.1]: is it in rad? Then it must be [-60.16" in said
        ) == told


def test_a_pose_of_a_list_that_may_be_in_rad_is_told(tmp_path: Path) -> None:
    (tmp_path / "p.json").write_text(
        '{"entries": [{"name": "a", "q_deg": [-1.05, -0.7, -1.4, 0, -1.05, 0.1]}]}'
    )
    typed = ("--list", tmp_path / "p.json", "--name", "a", "--unseen")
    said, _ = a465("move", CELL, "/dev/none-such", *typed, code=2)
    assert f"NOTE: {tmp_path / 'p.json'}: 'a' [-1.05, -0.7, -1.4, 0, -1.05, 0.1]: is it in rad?" in said


def test_a_shift_of_the_tool_in_m_is_told() -> None:
    for given, told in (
        ("--by=0,0,0.05", True),
        ("--along=0,0,-0.3", True),
        ("--by=0,0,0.6", False),
        ("--turn=0,0,0,0,0,90", False),
        ("--to=0,0,0.3", False),
    ):
        said, _ = a465("move", CELL, "/dev/none-such", given, "--unseen", code=2)
        assert (f"NOTE: {given}: the numbers are mm: the tool moves by at most" in said) == told
