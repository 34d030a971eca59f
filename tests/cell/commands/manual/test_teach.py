"""A taught pose is appended to the list, and nothing that was there is lost."""

from __future__ import annotations

import json
import re
import threading
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import cell.commands.manual.teach
from arm.errors import ExecutionStopped, FileInputError
from arm.io.claim import Claim
from cell.commands.manual.teach import taught_otherwise, teach_step
from cell.config.cell import Cell
from cell.files.pose_list import read_pose_list
from driver.emulator import Emulator
from emulated.on_pty import names_to, on_pty
from emulated.stepped_cell import push_to
from typed.command_line import a465
from typed.heard import Heard

from .conftest import CELL

AT = (10.0, -20.0, -60.0, 5.0, -60.0, 0.0)
QUERIES = {"ECHO", "STAMP", "VER?", "ST?", *(f"AP{axis}?" for axis in "ABCDEFGH")}


@pytest.fixture
def port(here: Cell, tmp_path: Path) -> Iterator[tuple[Emulator, str]]:
    with on_pty(here.unit, tmp_path / "unit.jsonl", homed_deg=AT) as served:
        yield served


def test_poses_are_appended_and_plan_poses_reads_them(
    here: Cell, port: tuple[Emulator, str], tmp_path: Path
) -> None:
    emulator, name = port
    taught = []
    for pose in ("above the tray", None):
        command = ("teach", "poses.json", CELL, name, *(("--name", pose) if pose else ()))
        a465(*command)
        taught.append(emulator.counts())
        push_to(emulator, np.array(emulator.counts()) + [2000, 30, -500, 40, 0, 7])
    listed = read_pose_list(Path("poses.json"))
    assert [entry.name for entry in listed.entries] == ["above the tray", "taught 1"]
    for entry, counts in zip(listed.entries, taught, strict=True):
        assert entry.q is not None
        np.testing.assert_array_equal(here.unit.counts(entry.q), counts)
    first = json.loads(Path("poses.json").read_text())["entries"][0]["taught"]
    T = here.robot().T_base_tool(here.unit.positions(taught[0]))
    np.testing.assert_allclose(first["T_base_tool"], T, atol=1e-6)
    assert (first["counts"], first["unit"]) == (list(taught[0]), "crs93")
    assert names_to(tmp_path / "unit.jsonl") <= QUERIES


def test_a_pose_that_was_taught_before_a_calibration_is_told(here: Cell, port: tuple[Emulator, str]) -> None:
    a465("teach", "poses.json", CELL, port[1], "--name", "tray")
    listed = read_pose_list(Path("poses.json"))
    assert taught_otherwise(listed, here) == []
    zero = here.unit.counts_at_zero + [50, 0, 0, 0, 0, 0]
    turned = replace(here, unit=replace(here.unit, counts_at_zero=zero))
    (line,) = taught_otherwise(listed, turned)
    assert re.search(
        r"^'tray' was taught with another calibration .* stood 0\.\d mm from .*; teach it again$",
        line,
    )
    (line,) = taught_otherwise(listed, replace(here, unit=replace(here.unit, name="crs97")))
    assert line == "'tray' was taught on crs93, and this cell has crs97"
    entry = listed.entries[0]
    bare = replace(listed, entries=(replace(entry, taught={"when": "yesterday"}), replace(entry, q=None)))
    assert taught_otherwise(bare, turned) == []


@pytest.mark.parametrize("bare", [False, True], ids=["object", "bare list"])
def test_what_the_list_has_stays(port: tuple[Emulator, str], bare: bool) -> None:
    entries = [
        {"name": "über", "q_deg": [0, -10, -90, 0, -70, 0], "jaws": "open"},
        [1, 0, 0, 0.42, 0, -1, 0, 0.15, 0, 0, -1, 0.3],
        {"jaws": 0.4, "dwell_s": 1.25},
    ]
    before = entries if bare else {"frame": "flange", "lengths": "m", "entries": entries}
    Path("poses.json").write_text(json.dumps(before))
    teach_step(Path("poses.json"), CELL, port[1], "here", Heard())
    after = json.loads(Path("poses.json").read_text())
    assert after["entries"][:-1] == entries
    assert after["entries"][-1]["name"] == "here"
    assert {key: value for key, value in after.items() if key != "entries"} == (
        {} if bare else {"frame": "flange", "lengths": "m"}
    )
    assert len(Path("poses.json").read_text().splitlines()) == len(entries) + (5 if bare else 7)


@pytest.mark.parametrize(
    ("content", "name", "words"),
    [
        ('{"entries": [{"name": "a", "q_deg": [0, 0, 0, 0, 0, 0]}]}', "a", "is in the list already"),
        ("{", "a", "is not JSON"),
        ('{"entries": [{"q": 3}]}', "a", "q"),
        ("[]", " ", "must not be empty"),
        ("[]", "a\nb", "must be a string of one line"),
        ("[]", "\udcff", "name"),
        ("[]", 101 * "x", "at most 100 printable characters"),
    ],
)
def test_a_list_that_cannot_be_extended_stays_as_it_is(content: str, name: str, words: str) -> None:
    Path("poses.json").write_text(content)
    with pytest.raises(FileInputError, match=words):
        teach_step(Path("poses.json"), CELL, "/dev/none-such", name, Heard())
    assert Path("poses.json").read_text() == content


def test_other_formats_are_refused() -> None:
    Path("poses.csv").write_text("0,0,0,0,0,0\n")
    _, told = a465("teach", "poses.csv", CELL, "/dev/none-such", code=2)
    assert "teach appends to lists in JSON only" in told
    _, told = a465("teach", "above the tray", CELL, "/dev/none-such", code=2)
    assert "must end in .json, as it is a list of poses (the name of a pose is given by --name)" in told


def test_a_list_of_another_arm_is_told_before_a_pose_is_added() -> None:
    taught = {"unit": "crs97", "counts": [0] * 6, "T_base_tool": np.eye(4).tolist()}
    entry = {"name": "a", "q_deg": [0, 10, -80, 0, -60, 0], "taught": taught}
    Path("poses.json").write_text(json.dumps({"entries": [entry]}))
    said, _ = a465("teach", "poses.json", CELL, "/dev/none-such", code=2)
    assert "NOTE: poses.json: 'a' was taught on crs97, and this cell has crs93" in said


def test_an_arm_whose_position_is_not_known_is_not_taught(here: Cell, tmp_path: Path) -> None:
    with on_pty(here.unit, tmp_path / "unit.jsonl") as (_, name):
        _, told = a465("teach", "poses.json", CELL, name, code=3)
    assert "the unit must be homed" in told
    assert not Path("poses.json").exists()


def test_a_moving_arm_is_not_taught(port: tuple[Emulator, str]) -> None:
    port[0].machine.run_axis("A", 5.0)
    with pytest.raises(ExecutionStopped, match="the arm moves"):
        teach_step(Path("poses.json"), CELL, port[1], None, Heard())
    assert not Path("poses.json").exists()


def test_two_at_the_same_time_lose_nothing(
    port: tuple[Emulator, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Another writes the list while this one would."""
    plain, file = cell.commands.manual.teach.read_arm, Path("poses.json").absolute()
    other = Claim(f"file {file}")

    def writes() -> None:
        file.write_text('{"entries": [{"name": "taught 1", "q_deg": [0, 0, 0, 0, 0, 0]}]}')
        other.release()

    def asked_meanwhile(*arguments: object) -> object:
        found = plain(*arguments)  # type: ignore[arg-type]
        threading.Timer(0.3, writes).start()
        return found

    monkeypatch.setattr(cell.commands.manual.teach, "read_arm", asked_meanwhile)
    teach_step(file, CELL, port[1], None, Heard())
    names = [entry["name"] for entry in json.loads(file.read_text())["entries"]]
    assert names == ["taught 1", "taught 2"]
