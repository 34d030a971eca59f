"""Opening a cell: what is missing is told first, and photographs of before are never taken for the cell of now."""

from __future__ import annotations

import os
import signal
import sys
import threading
import time
from pathlib import Path

import cv2
import numpy as np
import pytest

from arm.errors import InputError
from arm.io.storage import data_file
from cell.files.task import Task, read_task
from cell.files.world import read_world
from cell.session import connection
from cell.session.connection import (
    NewImageFolder,
    WhichCell,
    camera_at_start,
    open_cell,
    require_openable,
    simulated_cell,
    world_file,
)
from driver.line.signals import SIGNALS, interruptible
from typed.command_line import a465, replace_in
from vision.camera.frame_source import ImageFolder


@pytest.fixture(scope="module")
def task() -> Task:
    return read_task(data_file("scenes/task2.toml"))


def _photograph(path: Path, level: int) -> None:
    cv2.imwrite(str(path), np.full((8, 8), level, dtype=np.uint8))


def test_photographs_from_before_a_look_are_not_looked_at(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    _photograph(tmp_path / "a.png", 1)
    frames = NewImageFolder(tmp_path)

    def look(*levels: int) -> list[int]:
        def later() -> None:
            time.sleep(0.3)
            for level in levels:
                _photograph(tmp_path / f"b{level}.png", level)

        thread = threading.Thread(target=later)
        thread.start()
        seen = [int(image[0, 0]) for image in frames.grab(len(levels))]
        thread.join()
        return seen

    assert look(2, 3) == [2, 3]
    assert (
        "waiting for 2 new images under other names (the 1 already there does not count), for"
        in capsys.readouterr().err
    )
    _photograph(tmp_path / "b4.png", 4)  # between two looks: never handed out, yet of an older cell
    assert look(5) == [5]
    assert (
        "waiting for 1 new image under other names (the 4 already there do not count), for"
        in capsys.readouterr().err
    )


def test_a_photograph_that_is_still_being_copied_is_waited_for(tmp_path: Path) -> None:
    whole = cv2.imencode(".jpg", np.full((64, 64), 200, dtype=np.uint8))[1].tobytes()
    frames = NewImageFolder(tmp_path)

    def later() -> None:
        time.sleep(0.3)
        with (tmp_path / "a.jpg").open("wb") as file:
            for start in range(0, len(whole), len(whole) // 4):
                time.sleep(0.25)
                file.write(whole[start : start + len(whole) // 4])
                file.flush()

    thread = threading.Thread(target=later)
    thread.start()
    (image,) = frames.grab(1)
    thread.join()
    assert np.abs(image.astype(int) - 200).max() <= 2


def test_photographs_that_do_not_come_are_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(connection, "AWAIT_S", 0.3)
    _photograph(tmp_path / "a.png", 1)
    with pytest.raises(InputError, match="has 0 new images"):
        NewImageFolder(tmp_path).grab(1)
    with pytest.raises(InputError, match="no such folder"):
        NewImageFolder(tmp_path / "none")
    (phone := tmp_path / "phone").mkdir()
    (phone / "a.HEIC").touch()
    with pytest.raises(
        InputError, match=r"has 0 new images.*; it has files \.HEIC: save them as one of these"
    ):
        ImageFolder(phone).grab(1)


def test_a_world_that_is_not_there_is_told(task: Task, tmp_path: Path) -> None:
    assert world_file(task, None).name == "task2.world.toml"
    with pytest.raises(InputError, match="no such world file"):
        world_file(task, tmp_path / "none.toml")


@pytest.mark.parametrize(("second", "apart"), [(110, 0), (60, 50), (11, 99), (-130, None), (9, None)])
def test_two_boards_in_one_place_are_no_cell(scenes: Path, second: int, apart: int | None) -> None:
    """A copied table whose centre was not changed."""
    replace_in(scenes / "task2.world.toml", "centre_mm = [460, -130, 90]", f"centre_mm = [460, {second}, 40]")
    told = (
        f"{scenes / 'task2.world.toml'}: boards[1].centre_mm: boards 01-02 (boards[0]) and 03-04 stand in one place: "
        f"their centres are {apart} mm apart, must be at least 100"
    )
    task, typed = read_task(scenes / "task2.toml"), ("render", scenes / "task2.toml", "--count", 1)
    if apart is None:
        simulated_cell(task, None)
        return
    for open_one in (lambda: simulated_cell(task, None), lambda: camera_at_start(task, None)):
        with pytest.raises(InputError) as refused:
            open_one()
        assert str(refused.value) == told
    with pytest.raises(InputError), open_cell(task, WhichCell(), scenes / "wire.jsonl"):
        pass
    assert a465(*typed, code=2, cwd=scenes)[1] == f"a465: wrong input: {told}\n"
    assert not (scenes / "photographs").exists()
    read_world(scenes / "task2.world.toml", 0.036)  # a study of reach asks such worlds too


@pytest.mark.parametrize(
    ("port", "images", "time_scale", "message"),
    [
        (None, None, 0.0, "--time-scale 0: must be from"),
        (None, None, 101.0, "must be from 0.01 to 100"),
        (None, Path("photographs"), 1.0, "--images needs --port"),
        ("/dev/none", None, 1.0, "--time-scale 1 is for the simulated cell"),
        ("/dev/none", None, None, "--port needs a camera"),
    ],
)
def test_what_cannot_be_opened_is_told(
    task: Task, tmp_path: Path, port: str | None, images: Path | None, time_scale: float | None, message: str
) -> None:
    opened = open_cell(task, WhichCell(port, images=images, time_scale=time_scale), tmp_path / "wire.jsonl")
    with pytest.raises(InputError, match=message), opened:
        pass


def test_a_world_is_of_the_simulated_cell(task: Task) -> None:
    where = WhichCell("/dev/none", world=Path("task2.world.toml"), images=Path("photographs"))
    with pytest.raises(
        InputError, match=r"--world task2\.world\.toml is of the simulated cell; there is none"
    ):
        require_openable(task, where)


def test_a_board_with_markers_of_its_own_size_leaves_the_others_theirs(scenes: Path) -> None:
    """A plate of one's own comes first in the list: the markers of shipped boards are drawn as the cell file says."""
    own = "markers = [21, 22]\nmarker_size_mm = 32\nsecond_marker_mm = [150, 110]\nsize_mm = [220, 180, 15]\n"
    (scenes / "own.toml").write_text(f"{own}centre_mm = [75, 55]\n")
    replace_in(scenes / "cell.toml", "files = [", 'files = ["own.toml", ')
    simulated = simulated_cell(read_task(scenes / "task2.toml"), None)
    assert simulated.cell.boards[0].marker_size == 0.032
    assert [one.board.marker_size for one in simulated.world.boards] == [0.036, 0.036]


def test_a_port_that_cannot_be_opened_leaves_an_empty_log(task: Task, tmp_path: Path) -> None:
    log = tmp_path / "wire.jsonl"
    opened = open_cell(task, WhichCell("/dev/mars-that-is-not-there", blind=True), log)
    with pytest.raises(InputError, match="is not there"), opened:
        pass
    assert log.read_bytes() == b""


def test_contact_physics_is_for_the_simulated_cell_and_needs_its_library(
    task: Task, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(InputError, match="--cell mujoco is for the simulated cell"):
        require_openable(task, WhichCell("/dev/none", contact=True))
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(InputError, match="needs MuJoCo"):
        require_openable(task, WhichCell(contact=True))
    require_openable(task, WhichCell())


def _send_myself(number: signal.Signals) -> None:
    os.kill(os.getpid(), number)
    time.sleep(1.0)


@pytest.mark.parametrize("number", SIGNALS, ids=lambda s: s.name)
def test_every_way_to_end_the_program_is_heard(number: signal.Signals) -> None:
    before = signal.getsignal(number)
    with pytest.raises(KeyboardInterrupt, match=number.name), interruptible():
        _send_myself(number)
    assert signal.getsignal(number) == before


def test_a_world_without_a_board_of_the_task_is_no_cell_for_it(scenes: Path) -> None:
    told = a465("look", str(scenes / "task2.toml"), "--world", str(scenes / "task1.world.toml"), code=2)[1]
    assert (
        f"{scenes / 'task1.world.toml'}: boards: have no board 03-04, which {scenes / 'task2.toml'} needs"
        in told
    )
