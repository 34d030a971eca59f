"""``a465 new-cell`` at a terminal asks for what only the owner of a cell knows."""

from __future__ import annotations

import os
import pty
import select
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from arm.errors import InputError
from cell.commands.new_cell import new_cell_step
from cell.config.cell_file import read_cell
from typed.heard import Heard


def _answering(*lines: str | None) -> Callable[[], str | None]:
    rest = iter(lines)
    return lambda: next(rest)


@pytest.mark.parametrize(
    ("port", "kept"), [("/dev/mars", "/dev/mars"), ("mars", "../mars"), ("socket://10.0.0.1:4001", None)]
)
@pytest.mark.parametrize("camera", ["name:hall 3", "video:0"])
def test_a_person_is_asked_for_what_only_the_owner_knows(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, port: str, kept: str | None, camera: str
) -> None:
    monkeypatch.chdir(tmp_path)
    heard = Heard()
    new_cell_step(Path("mine"), None, None, heard, _answering("crs97", port, camera, " 150.5 "))
    cell = read_cell(tmp_path / "mine/cell.toml")
    assert cell.unit.name == "crs97"
    assert f'port = "{kept or port}"' in (tmp_path / "mine/cell.toml").read_text()
    assert cell.live_camera.device == camera
    assert cell.tool.T_flange_tool[2, 3] == pytest.approx(0.1505)
    assert "gripper" in heard.all


def test_enter_leaves_what_is_not_known_yet(tmp_path: Path) -> None:
    new_cell_step(tmp_path / "asked", None, "c", Heard(), _answering("crs93", "", " ", ""))
    new_cell_step(tmp_path / "told", "crs93", "c", Heard())
    for name in ("cell.toml", "task1.toml"):
        assert (tmp_path / "asked" / name).read_text() == (tmp_path / "told" / name).read_text()


def test_a_wrong_answer_is_asked_again_and_the_third_is_refused(tmp_path: Path) -> None:
    heard = Heard()
    lines = (
        "crs99",
        "CRS93",
        "crs93",
        "tcp://x",
        "/dev/mars",
        "film:1",
        "video:film.avi",
        "name:a",
        "12",
        "x",
        "140",
    )
    new_cell_step(tmp_path / "mine", None, None, heard, _answering(*lines))
    assert heard.all.count("more tr") == 7
    assert "must be a device or a stream, not a recording" in heard.all
    with pytest.raises(InputError, match="--unit c: must be one of crs93, crs97"):
        new_cell_step(tmp_path / "other", None, None, heard, _answering("a", "b", "c", "crs93"))
    for lines in ((None,), ("",), ("crs93", None)):
        with pytest.raises(InputError, match=r"nobody answered|--unit is missing"):
            new_cell_step(tmp_path / "other", None, None, heard, _answering(*lines))
    assert not (tmp_path / "other").exists()


def test_a_name_or_folder_that_is_refused_is_told_before_anything_is_asked(tmp_path: Path) -> None:
    (tmp_path / "full").mkdir()
    (tmp_path / "full/file").touch()
    for folder, name in (("full", None), ("mine", "a\nb")):
        with pytest.raises(InputError):
            new_cell_step(tmp_path / folder, None, name, Heard(), _answering())


@pytest.mark.slow
def test_at_a_terminal(tmp_path: Path) -> None:
    """The command as a person types it, on a real pseudo-terminal."""
    child, master = pty.fork()
    if child == 0:
        os.chdir(tmp_path)
        os.execv(sys.executable, [sys.executable, "-m", "a465", "new-cell", "mine"])
    said = b""
    answers = {b"label says": b"crs93", b"/dev/mars": b"/dev/mars", b"camera-crs93": b"", b"134.112": b""}
    for asked, line in answers.items():
        over = time.monotonic() + 60.0
        while asked not in said:
            ready, _, _ = select.select([master], [], [], max(over - time.monotonic(), 0.0))
            assert ready, said
            said += os.read(master, 4096)
        os.write(master, line + b"\n")
        said = b""
    _, status = os.waitpid(child, 0)
    os.close(master)
    assert os.waitstatus_to_exitcode(status) == 0
    assert 'port = "/dev/mars"' in (tmp_path / "mine/cell.toml").read_text()
