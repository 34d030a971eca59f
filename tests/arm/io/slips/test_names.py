"""A name of no file is told by what is near it; within a file, as it has to be written there."""

from __future__ import annotations

from pathlib import Path

import pytest

from arm.errors import FileInputError
from arm.io.slips.names import missing, no_file
from arm.io.storage import read_text


def test_a_file_that_is_not_there_is_told_by_what_is_near(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "scenes").mkdir()
    (tmp_path / "scenes" / "cell.toml").touch()
    monkeypatch.chdir(tmp_path)
    told = {
        "scenes/cel.toml": "is it scenes/cell.toml?",
        "scenes/cell": "is it scenes/cell.toml?",
        "scenes/Cell.TOML": "is it scenes/cell.toml?",
        "scene": "is it scenes?",
        "cell.toml": "is it scenes/cell.toml?",
        "scenes\\cell.toml": "with / for \\ it is scenes/cell.toml",
        "Scenes/cell.toml": "there is no folder Scenes",
        "https:/host/cell.toml": "it is an address; download the file, and give its path",
        "package:/lab/cell.toml": "packages of ROS are not searched; give the file's path",
        "~/cell.toml": "~ and $NAME stand for nothing within quotes or in a file; write the path out",
        "$HOME/cell.toml": "~ and $NAME stand for nothing within quotes or in a file; write the path out",
        "scenes/*.json": "no name matches the pattern",
        "other": "",
    }
    assert {name: missing(Path(name)) for name in told} == told
    monkeypatch.chdir(tmp_path / "scenes")
    assert missing(Path("scenes/cell.toml")) == "from this folder it is cell.toml"
    with pytest.raises(FileInputError, match=r"No such file or directory \(is it cell\.toml\?\)"):
        read_text(Path("cel.toml"))


def test_names_in_a_file_are_proposed_as_they_stand_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("mine/boards/01-02.csv", "mine/lab.toml", "shared/lens.toml", "other/far.csv"):
        (tmp_path / name).parent.mkdir(exist_ok=True, parents=True)
        (tmp_path / name).touch()
    monkeypatch.chdir(tmp_path)
    cell = Path("mine/cell.toml")
    (tmp_path / "links").mkdir()
    (tmp_path / "links/cell.toml").symlink_to(tmp_path / "mine/cell.toml")
    relative = "names are relative to the folder of cell.toml: "
    told = {
        "01-02.csv": 'is it "boards/01-02.csv"?',
        "boards/01_02.csv": 'is it "boards/01-02.csv"?',
        "cameras/lab.toml": f'{relative}"lab.toml" is there',
        "shared/lens.toml": f'{relative}"../shared/lens.toml"',
        "plates/new.csv": "there is no folder mine/plates",
        "new.csv": "",
        "$HOME/new.csv": "~ and $NAME stand for nothing within quotes or in a file; write the path out",
    }
    assert {name: no_file(cell.parent / name, cell)[1] for name in told} == told
    assert no_file(Path("links/lab.toml"), Path("links/cell.toml"))[1].startswith("a link leads to ")
    assert no_file(cell.parent / "boards", cell) == ("names a folder, must name a file: mine/boards", "")
