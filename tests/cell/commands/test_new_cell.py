"""``a465 new-cell``: it writes the shipped scene with comments, which works at once, and all of it or nothing."""

from __future__ import annotations

import errno
import json
import re
import shlex
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import typer

import cell.export.folder
from arm.errors import InputError
from arm.io.node import REQUIRED
from arm.io.storage import data_file, write_atomic
from arm.se3 import apply
from cell.cli.main import app
from cell.commands import new_cell as newcell
from cell.commands.new_cell import PLACEHOLDER, new_cell_step, next_commands
from cell.config.cell_file import read_cell
from cell.console import Console
from cell.files.hand_target import read_hand_target
from cell.files.task import read_task
from cell.files.world import read_world
from cell.task.planning import Rest, plan_rest
from cell.texts.key_texts import declared_keys
from tasks.true_look import true_look
from typed.command_line import a465, refused, replace_in
from typed.doc_pages import ROOT
from vision.camera.video.settings import VideoSettings

NOT_OFFERED = (
    *("calibration", "background", "tool.urdf", "look.basler.features", "look.video.features", "camera"),
    *("intrinsics.covariance", "intrinsics.region_px", "views"),
    *("tool.off_mm", "tool.turned_deg", "tool.ring_mm", "work.off_mm", "work.turned_deg"),  # of programs
)
KEY = re.compile(r"^(\w+) = ")


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """A new cell of each unit."""
    folder = tmp_path_factory.mktemp("cells")
    for unit in ("crs93", "crs97"):
        a465("new-cell", folder / unit, "--unit", unit, "--name", "of the lab")
    return {unit: folder / unit for unit in ("crs93", "crs97")}


@pytest.mark.parametrize("unit", ["crs93", "crs97"])
@pytest.mark.parametrize("name", ["task1", "task2"])
def test_it_reads_back_as_the_shipped_scene(written: dict[str, Path], unit: str, name: str) -> None:
    task, shipped = read_task(written[unit] / f"{name}.toml"), read_task(data_file(f"scenes/{name}.toml"))
    assert task.cell.unit.name == unit
    assert task.digest == shipped.digest  # all that both files say but unit and camera
    assert task.cell.camera.digest == shipped.cell.camera.digest
    assert task.cell.camera_file == written[unit] / "camera.toml"
    assert task.cell.camera.calibration == {"id": PLACEHOLDER}
    here, there = (
        read_world(folder / f"{name}.world.toml", 0.036) for folder in (written[unit], data_file("scenes"))
    )
    assert (here.seed, here.noise_grey) == (there.seed, there.noise_grey)
    for a, b in zip(here.boards, there.boards, strict=True):
        assert (a.board.name, a.cubes) == (b.board.name, b.cubes)
        np.testing.assert_array_equal(a.T_base_board, b.T_base_board)


def test_the_target_is_the_shipped_one(written: dict[str, Path]) -> None:
    hand, shipped = (
        read_hand_target(file)
        for file in (written["crs93"] / "hand.toml", data_file("scenes/targets/hand.toml"))
    )
    assert hand.target.label() == shipped.target.label()
    assert hand.plate == shipped.plate
    np.testing.assert_array_equal(hand.T_flange_target, shipped.T_flange_target)


@pytest.mark.parametrize("unit", ["crs93", "crs97"])
@pytest.mark.parametrize("name", ["task1", "task2"])
def test_its_tasks_plan(written: dict[str, Path], unit: str, name: str) -> None:
    replace_in(written[unit] / f"{name}.toml", 'order = "free"', 'order = "given"')
    task = read_task(written[unit] / f"{name}.toml")
    plan = plan_rest(Rest(task, true_look(task), task.cell.q_start, task.cell.speed, skip=(0, 1, 3)))
    assert plan is not None
    assert plan.unit == unit
    assert [cube["from"] for cube in plan.task["cubes"]] == ["01-02/3"]
    assert min(move.clearance for move in plan.moves) >= 0.005


@pytest.mark.slow
def test_it_places_a_cube_in_the_simulated_cell(tmp_path: Path) -> None:
    a465("new-cell", "mine", "--unit", "crs93", cwd=tmp_path)
    replace_in(tmp_path / "mine/task2.world.toml", "cubes = [1, 2, 3, 4]", "cubes = [3]")
    replace_in(tmp_path / "mine/task2.toml", 'look_after = "each"', 'look_after = "never"')
    said, _ = a465("run", "mine/task2.toml", "--time-scale", 50, "-o", "ran", "--json", cwd=tmp_path)
    (cube,) = json.loads(said)["cubes"]
    assert cube["placed"]


def test_every_key_has_a_comment_and_every_comment_a_key(written: dict[str, Path]) -> None:
    for name, (_, _, kind) in newcell._FILES.items():
        text = (written["crs93"] / name).read_text()
        lines = text.splitlines()
        keys = [i for i, line in enumerate(lines) if KEY.match(line)]
        assert keys
        assert all(lines[i - 1].startswith("# ") for i in keys), name
        assert max(map(len, lines)) <= 120
        assert not re.findall(r"^# \w+ = .*#\s*$", text, re.M), name  # an offer without a text
        named = set(_names("", tomllib.loads(text)))
        offered = set(re.findall(r"^# (\w+) = .*# \w", text, re.M))
        for key, one in declared_keys(kind).items():
            if "[]" not in key and key not in NOT_OFFERED:
                assert key in named or (key.rpartition(".")[2] in offered and one.default is not REQUIRED), (
                    key
                )


def _names(prefix: str, value: dict[str, Any]) -> list[str]:
    names = []
    for key, inner in value.items():
        names.append(prefix + key)
        for table in inner if isinstance(inner, list) else [inner]:
            names += _names(f"{prefix}{key}.", table) if isinstance(table, dict) else []
    return names


def test_what_may_be_added_reads_too(tmp_path: Path) -> None:
    new_cell_step(tmp_path / "mine", "crs93", None, Console(as_json=True))
    file = tmp_path / "mine/cell.toml"
    text = re.sub(
        r"^# (\w+ = (?!\[\.)|\[(?:look|solver|accuracy|recovery))",
        r"\1",
        file.read_text(),
        flags=re.MULTILINE,
    )
    file.write_text(text)
    cell = read_cell(file)
    assert cell.live_camera.device == "name:MY-CAMERA"
    assert cell.live_camera.basler.exposure == 0.008
    assert cell.live_camera.video == VideoSettings((1920, 1200), None, 0.0, 0.5, 2.0, True)
    shipped = read_cell(data_file("scenes/cell.toml"))
    for key in (
        "velocity_fraction",
        "acceleration_fraction",
        "jerk_time",
        "timing",
        "solver",
        "board_limits",
    ):
        assert getattr(cell, key) == getattr(shipped, key)  # what is not said is as shown
    assert {"velocity_fraction", "acceleration_fraction", "jerk_time_s"} <= set(tomllib.loads(text)["motion"])


@pytest.mark.parametrize("name", ["task1", "task2"])
def test_the_pose_by_tape_that_it_offers_has_the_boards_in_view(tmp_path: Path, name: str) -> None:
    new_cell_step(tmp_path / "mine", "crs93", None, Console(as_json=True))
    file = tmp_path / "mine/camera.toml"
    text = re.sub(r"^T_base_camera = \[\n.*?^\]\n", "", file.read_text(), flags=re.M | re.S)
    file.write_text(re.sub(r"^# (position|looks_at|right_azimuth)", r"\1", text, flags=re.M))
    camera = read_task(tmp_path / f"mine/{name}.toml").cell.camera
    shipped = read_task(data_file(f"scenes/{name}.toml")).cell.camera
    assert np.linalg.norm(camera.T_base_camera[:3, 3] - shipped.T_base_camera[:3, 3]) < 0.01
    assert (camera.T_base_camera[:3, 2] @ shipped.T_base_camera[:3, 2]) > np.cos(np.radians(1.0))
    for board in read_world(tmp_path / f"mine/{name}.world.toml", 0.036).boards:
        pixels = camera.project_base(apply(board.T_base_board, board.board.marker_corners()))
        assert ((pixels >= 10.0) & (pixels <= np.array(camera.size) - 10.0)).all()


def test_the_name_is_in_the_cell_file_and_the_folders_is_the_default(tmp_path: Path) -> None:
    for name, called in ((None, "mine"), ("Zelle {unit} é", "Zelle {unit} é")):
        folder = tmp_path / (name or "mine")
        assert new_cell_step(folder, "crs93", name, Console(as_json=True))["name"] == called
        assert (folder / "cell.toml").read_text().startswith(f"# The work cell {called}: ")


def test_an_empty_folder_is_taken(tmp_path: Path) -> None:
    (tmp_path / "mine").mkdir()
    (tmp_path / "link").symlink_to("mine")
    a465("new-cell", "link", "--unit", "crs93", cwd=tmp_path)
    assert (tmp_path / "link").is_symlink()
    assert (tmp_path / "mine/cell.toml").is_file()
    assert sorted(p.name for p in tmp_path.iterdir()) == ["link", "mine"]


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["full"], "full: is not empty (.hidden); give a new or an empty folder"),
        (["file"], "file: is not a usable folder: it is a file; give a new or an empty folder"),
        (["file/mine"], "file/mine: "),
        (["."], "is the current folder and cannot be replaced; give a new one"),
        (["new", "--unit", "crs3"], "--unit crs3: must be one of crs93, crs97"),
        (
            ["new", "--unit", "CRS93"],
            "--unit CRS93: must be one of crs93, crs97, or a unit file (.toml); did you mean crs93?",
        ),
        (
            ["new", "--unit", "crs93", "--name", "two\nlines"],
            "must be a line of 1 to 60 printable characters",
        ),
        (["new", "--unit", "crs93", "--name", " "], "must be a line of 1 to 60"),
        (["new", "--unit", "crs93", "--name", "n" * 61], "must be a line of 1 to 60"),
    ],
)
def test_what_is_refused_writes_nothing(tmp_path: Path, arguments: list[str], told: str) -> None:
    here = tmp_path / "here"
    (here / "full").mkdir(parents=True)
    (here / "full/.hidden").write_text("kept")
    (here / "file").write_text("kept")
    if arguments == ["."]:
        here = tmp_path / "empty"
        here.mkdir()
    before = sorted(tmp_path.rglob("*"))
    unit = [] if "--unit" in arguments else ["--unit", "crs93"]
    _, err = a465("new-cell", *arguments, *unit, code=2, cwd=here)
    assert told in err
    assert len(err.strip().splitlines()) == 1
    assert sorted(tmp_path.rglob("*")) == before


@pytest.mark.slow
def test_a_refusal_is_the_same_optimised(tmp_path: Path) -> None:
    (tmp_path / "full").mkdir()
    (tmp_path / "full/x").write_text("")
    assert "wrong input: full: is not empty (x)" in refused(
        "new-cell", "full", "--unit", "crs93", code=2, cwd=tmp_path
    )


def test_all_files_are_written_or_none(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "mine").mkdir()
    count = [0]

    def full_disk(path: Path, data: bytes | str) -> None:
        count[0] += 1
        if count[0] == 10:
            raise OSError(errno.ENOSPC, "No space left on device")
        write_atomic(path, data)

    monkeypatch.setattr(cell.export.folder, "write_atomic", full_disk)
    with pytest.raises(InputError, match="mine: cannot be written: No space left on device"):
        new_cell_step(tmp_path / "mine", "crs93", None, Console(as_json=True))
    assert count[0] == 10
    assert list(tmp_path.rglob("*")) == [tmp_path / "mine"]


def test_what_somebody_puts_there_meanwhile_is_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "mine").mkdir()

    def beside_another_program(path: Path, data: bytes | str) -> None:
        (tmp_path / "mine/x").write_text("kept")
        write_atomic(path, data)

    monkeypatch.setattr(cell.export.folder, "write_atomic", beside_another_program)
    with pytest.raises(InputError, match="cannot be written: Directory not empty"):
        new_cell_step(tmp_path / "mine", "crs93", None, Console(as_json=True))
    assert sorted(tmp_path.rglob("*")) == [tmp_path / "mine", tmp_path / "mine/x"]


def test_the_next_commands_are_told_in_order_and_exist(tmp_path: Path) -> None:
    said, _ = a465("new-cell", "my cell", "--unit", "crs93", cwd=tmp_path)
    lines = [line for line in said.splitlines() if line.startswith("a465 ")]
    assert lines == [line for _, line in next_commands(Path("my cell"), "crs93") if line]
    words = [shlex.split(line)[1:] for line in lines]
    for arguments in words:
        _parse(typer.main.get_command(app), arguments)
        files = [
            a for a in arguments if a.endswith(".toml") and not a.endswith(("lens.toml", "calibration.toml"))
        ]
        assert all((tmp_path / file).is_file() for file in files)
    a465(*words[1], cwd=tmp_path)


def test_the_next_steps_are_those_of_the_pages() -> None:
    steps = next_commands(Path("my-cell"), "crs93")
    lines = [line for _, line in steps if line]
    at = lines.index("a465 record /dev/mars -o my-cell/unit.json")
    own, real = ((ROOT / "docs" / page).read_text() for page in ("new-cell.md", "real-cell.md"))
    places = [own.find(f"`{line}`") for line in lines[:at]]
    assert at == 3
    assert -1 not in places
    assert places == sorted(places)
    typed = [line.partition("  #")[0].rstrip() for line in re.findall(r"^a465 .*$", real, re.M)]
    assert typed[:2] == ["a465 new-cell my-cell --unit crs93", lines[1]]
    again = ("a465 status ", "a465 record --compare ")
    assert [line for line in typed[2:] if not line.startswith(again)] == lines[at:]


def test_the_next_steps_home_once_before_anything_stands_there() -> None:
    steps = next_commands(Path("my-cell"), "crs93")
    (home,) = (i for i, (_, line) in enumerate(steps) if line.startswith("a465 home "))
    assert "step 4" in steps[home][0]
    moving = [i for i, (_, line) in enumerate(steps) if "--port" in line and "doctor" not in line]
    assert min(moving) > home
    assert all("--homed --speed 0.1" in steps[i][1] for i in moving)
    told = [why for why, _ in steps]
    for step, line in (
        (2, "a465 check "),
        (5, "--live"),
        (6, "--collect my-cell/task2.toml --target my-cell/hand.toml --p"),
    ):
        assert [f"step {step}" in why for why, command in steps if line in command] == [True]
    assert [i for i, why in enumerate(told) if "clearance_mm" in why and "step 7" in why] == [
        i for i, (_, line) in enumerate(steps) if line.startswith("a465 plan ")
    ]


def _parse(command: Any, arguments: list[str]) -> None:
    """Every word is known to the command line; nothing is run."""
    context = command.make_context(command.name, arguments)
    if hasattr(command, "commands"):
        _, inner, rest = command.resolve_command(context, [*context._protected_args, *context.args])
        _parse(inner, rest)
    else:
        assert not context.args


def test_json_says_the_same(tmp_path: Path) -> None:
    said, told = a465("new-cell", "mine", "--unit", "crs97", "--json", cwd=tmp_path)
    report = json.loads(said)
    assert report["unit"] == "crs97"
    assert sorted(report["files"]) == sorted(
        str(p.relative_to(tmp_path / "mine")) for p in (tmp_path / "mine").rglob("*") if p.is_file()
    )
    assert all(entry["command"] in told for entry in report["next"])


def test_it_asks_which_arm_it_is(tmp_path: Path) -> None:
    _, err = a465("new-cell", "mine", code=2, cwd=tmp_path)
    assert "--unit is missing" in err
    assert "crs93 or crs97" in err
    assert not (tmp_path / "mine").exists()


def test_a_folder_that_is_named_as_a_file_is_written_and_told(tmp_path: Path) -> None:
    told, _ = a465("new-cell", "hall.toml", "--unit", "crs93", cwd=tmp_path)
    assert (tmp_path / "hall.toml" / "cell.toml").is_file()
    note = "note: hall.toml is a folder, though its name ends as a file's does; did you mean hall?"
    assert note in " ".join(told.split())
    assert "note:" not in a465("new-cell", "hall", "--unit", "crs93", cwd=tmp_path)[0]


def test_a_unit_in_place_of_the_folder_is_told(tmp_path: Path) -> None:
    _, told = a465("new-cell", "crs93", code=2, cwd=tmp_path)
    assert told.endswith("; crs93 is read as the folder: a465 new-cell my-cell --unit crs93\n")
