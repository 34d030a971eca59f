"""What the verbs around calibration refuse before anything is read."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

from arm.errors import InputError
from arm.io.storage import data_file
from cell.commands.calibration.chain import ChainOptions
from recorded.found_chains import STEPS, Step
from typed.heard import Heard


@STEPS
@pytest.mark.parametrize(
    ("limit_mm", "encoder_step_deg", "words"),
    [
        (0.0, None, "--limit-mm 0: must be above 0 mm"),
        (-1.0, None, "--limit-mm -1: must be above 0 mm"),
        (np.inf, None, "--limit-mm inf: must be above 0 mm and finite"),
        (np.nan, None, "--limit-mm nan: must be above 0 mm and finite"),
        (None, -0.1, "--encoder-step-deg -0.1: must be from 0 to 5 deg"),
        (None, 5.1, "--encoder-step-deg 5.1: must be from 0 to 5 deg"),
        (None, np.nan, "--encoder-step-deg nan: must be from 0 to 5 deg"),
    ],
)
def test_options_are_seen_before_anything_is_read(
    tmp_path: Path, step: Step, limit_mm: float | None, encoder_step_deg: float | None, words: str
) -> None:
    with pytest.raises(InputError) as told:
        step(tmp_path / "gone.json", ChainOptions(None, None, limit_mm, encoder_step_deg), Heard())
    assert words in str(told.value)


@STEPS
@pytest.mark.parametrize(
    ("output", "report", "words"),
    [
        ("data.json", None, "data.json: is read by this command"),
        ("c.toml", "data.json", "data.json: is read by this command"),
        ("folder", None, "is not a regular file"),
        ("c.toml", "folder", "is not a regular file"),
        ("page.html", None, "is also the name of the report"),
        ("c.toml", "folder/../c.toml", "is also the name of the report"),
    ],
)
def test_files_that_cannot_be_written_are_refused_before_anything_is_read(
    tmp_path: Path, step: Step, output: str, report: str | None, words: str
) -> None:
    (tmp_path / "folder").mkdir()
    data = tmp_path / "data.json"
    data.write_text("not a recording")
    with pytest.raises(InputError) as told:
        step(data, ChainOptions(tmp_path / output, None if report is None else tmp_path / report), Heard())
    assert words in str(told.value)
    assert data.read_text() == "not a recording"


OTHERS = (
    "scenes/cell.toml",
    "scenes/task2.toml",
    "scenes/task2.world.toml",
    "scenes/cameras/lab.toml",
    "scenes/targets/hand.toml",
    "urdf/a465/a465.urdf",
)


@STEPS
@pytest.mark.parametrize("as_report", [False, True])
@pytest.mark.parametrize("other", [*OTHERS, "board"])
def test_no_file_of_another_kind_is_written_over(
    tmp_path: Path, step: Step, as_report: bool, other: str
) -> None:
    file = sorted(data_file("scenes").rglob("*.csv"))[0] if other == "board" else data_file(other)
    there = tmp_path / file.name
    shutil.copyfile(file, there)
    given = (tmp_path / "new.toml", there) if as_report else (there, None)
    with pytest.raises(InputError, match="that this command wrote, so it is not overwritten") as told:
        step(tmp_path / "not read.json", ChainOptions(*given), Heard())
    assert str(there) in str(told.value)
    assert there.read_bytes() == file.read_bytes()


@STEPS
def test_a_name_that_can_have_no_folder_is_refused_before_anything_is_read(
    tmp_path: Path, step: Step
) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="is not writable") as told:
        step(tmp_path / "not read.json", ChainOptions(tmp_path / "file" / "x" / "c.toml"), Heard())
    assert str(tmp_path / "file") in str(told.value)


@STEPS
@pytest.mark.parametrize("name", ["", ".", "/", "loop.toml", "loop.toml/c.toml", "x" * 300 + ".toml"])
def test_what_is_no_name_of_a_file_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, step: Step, name: str
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("loop.toml").symlink_to("loop.toml")
    for given in ((Path(name), None), (None, Path(name))):
        with pytest.raises(InputError, match="file") as told:
            step(Path("not read.json"), ChainOptions(*given), Heard())
        assert "not read" not in str(told.value)
        assert len(str(told.value).splitlines()) == 1
