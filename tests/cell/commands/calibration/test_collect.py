"""What collecting poses refuses before anything opens or is chosen."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import cell.collect.pose_pool
import cell.collect.recipe_270
import cell.commands.calibration.collect
import cell.session.connection
from arm.errors import ImpossibleError, InputError
from arm.io.storage import data_file
from cell.collect.collector import CollectOptions
from cell.commands.calibration.chain import ChainOptions
from cell.commands.calibration.collect import CollectFiles, collect_step
from cell.console import Console
from cell.session.connection import WhichCell
from tasks.collecting import FAST
from typed.command_line import a465
from typed.heard import Heard
from wire.lasting_cell import LastingCell

HAND = data_file("scenes/targets/hand.toml")


@pytest.fixture
def no_choice(monkeypatch: pytest.MonkeyPatch) -> None:
    """Poses take long to choose: whoever gets there has seen all that can be seen before."""

    def chosen(*_: object) -> None:
        raise RuntimeError("poses are chosen")

    monkeypatch.setattr(cell.commands.calibration.collect, "choose_poses", chosen)


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"poses": 5}, "--poses 5: must be from 8 to 300"),
        ({"seed": -1}, "--seed -1: must be 0 or more"),
        ({"output": None}, "--apply needs -o FILE"),
        ({"output": "camera"}, "camera.toml: is read by this command"),
        ({"output": "folder"}, "is not a regular file"),
        ({"output": "task"}, "task2.toml: is read by this command"),
        ({"output": "world"}, "task2.world.toml: is read by this command"),
        ({"output": "board"}, "so it is not overwritten"),
        ({"output": "urdf"}, "a465.urdf: exists and is no calibration"),
        ({"output": "recording"}, "recorded.json: is also the name of an input"),
        ({"step": 6.0}, "--encoder-step-deg 6: must be from 0 to 5 deg"),
        ({"speed": 2.0}, "--speed 2: must be from 0.01 to 1"),
        ({"recording": "recorded.txt"}, "must end in .json"),
    ],
)
def test_what_cannot_be_is_refused_before_anything_opens(
    no_choice: None, tmp_path: Path, changed: dict[str, object], words: str
) -> None:
    task = data_file("scenes/uncalibrated/task2.toml")
    named = {
        "task": task,
        "camera": task.parent / "camera.toml",
        "folder": task.parent,
        "world": task.with_suffix(".world.toml"),
        "board": min(data_file("scenes").rglob("*.csv")),
        "urdf": data_file("urdf/a465/a465.urdf"),
        "recording": tmp_path / "recorded.json",
    }
    output = changed.get("output", tmp_path / "c.toml")
    files = CollectFiles(
        tmp_path / str(changed.get("recording", "recorded.json")),
        task,
        HAND,
        tmp_path / "run",
        True,
    )
    options = ChainOptions(named.get(output, output), encoder_step_deg=changed.get("step"))  # type: ignore[call-overload, arg-type]
    where = WhichCell(speed=changed.get("speed"))  # type: ignore[arg-type]

    def asked() -> None:
        poses = CollectOptions.of(changed.get("poses", 8), changed.get("seed"), False)  # type: ignore[arg-type]
        collect_step(files, poses, options, where, Console())

    with pytest.raises(InputError) as told:
        asked()
    assert words in str(told.value)
    assert list(tmp_path.iterdir()) == []


def test_options_of_a_collection_go_with_it(tmp_path: Path) -> None:
    _, said = a465("calibrate", "hand-eye", "recorded.json", "--poses", "9", code=2, cwd=tmp_path)
    assert "--poses needs --collect TASK" in said


@pytest.mark.parametrize(
    ("where", "words"),
    [
        (WhichCell(time_scale=0.0), "--time-scale 0: must be from 0.01 to 100"),
        (WhichCell(port="/dev/none", time_scale=2.0), "--time-scale 2 is for the simulated cell"),
        (WhichCell(images=Path("shots")), "--images needs --port"),
        (WhichCell(camera="name:a"), "--camera needs --port"),
        (WhichCell(port="/dev/none", images=Path("shots"), camera="name:a"), "give only one source"),
        (WhichCell(port="/dev/none", images=Path("not there")), "not there: no such folder"),
        (WhichCell(port="/dev/none", camera="colour:red"), "colour"),
        (WhichCell(port="/dev/none"), "--port needs a camera"),
        (WhichCell(port="/dev/none", camera="cell"), "camera"),
        (WhichCell(world=Path("not there.toml")), "no such world file"),
        (WhichCell(speed=2.0), "--speed 2: must be from 0.01 to 1"),
    ],
)
def test_where_the_poses_are_taken_is_seen_before_any_is_chosen(
    no_choice: None, tmp_path: Path, where: WhichCell, words: str
) -> None:
    files = CollectFiles(tmp_path / "recorded.json", data_file("scenes/uncalibrated/task2.toml"), HAND)
    with pytest.raises(InputError) as told:
        collect_step(files, CollectOptions(8), ChainOptions(), where, Heard())
    assert words in str(told.value)


def test_a_unit_that_was_not_homed_is_refused_before_poses_are_chosen(
    no_choice: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    lasting = LastingCell(tmp_path, monkeypatch, "task2")
    files = CollectFiles(tmp_path / "recorded.json", lasting.file, HAND, folder=tmp_path / "run")
    where = WhichCell(lasting.url, homed=True)
    with (
        lasting.emulator,
        pytest.raises(
            ImpossibleError, match="as after power-up or an interrupted homing: the unit must be homed"
        ),
    ):
        collect_step(files, CollectOptions(8), ChainOptions(), where, Heard())


def test_a_person_confirms_after_the_poses_are_chosen(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    order: list[str] = []
    chosen = np.zeros((1, 6)), np.zeros((1, 6))

    def choose(*_: object) -> tuple[np.ndarray, np.ndarray]:
        order.append("poses are chosen")
        return chosen

    def confirm(_: object) -> None:
        order.append("asked")
        raise InputError("no", option="--unseen")

    monkeypatch.setattr(cell.commands.calibration.collect, "choose_poses", choose)
    task = data_file("scenes/uncalibrated/task2.toml")
    files = CollectFiles(tmp_path / "recorded.json", task, HAND, folder=tmp_path / "run")
    with pytest.raises(InputError, match="no"):
        collect_step(files, CollectOptions(8), ChainOptions(), FAST, Heard(), confirm)
    assert order == ["poses are chosen", "asked"]


def test_a_folder_that_holds_something_is_refused_before_poses_are_chosen(
    no_choice: None, tmp_path: Path
) -> None:
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / "plan.json").touch()
    task = data_file("scenes/uncalibrated/task2.toml")
    files = CollectFiles(tmp_path / "recorded.json", task, HAND, folder=tmp_path / "run")
    with pytest.raises(InputError, match="new or empty folder"):
        collect_step(files, CollectOptions(8), ChainOptions(), FAST, Heard())
    with pytest.raises(RuntimeError, match="poses are chosen"):
        collect_step(replace(files, folder=None), CollectOptions(8), ChainOptions(), FAST, Heard())
