"""Which camera looks at the cell, by command line and cell file; through pylon's emulation to the very end."""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import cv2
import numpy as np
import pytest

import cell.session.connection
from arm.errors import CameraError, ExecutionStopped, InputError
from arm.io.storage import data_file
from cell.cli.main import app
from cell.commands.render import render_step
from cell.commands.run import execute_plan
from cell.commands.steps import look_step, plan_step
from cell.config.camera_keys import CellCamera
from cell.config.cell_file import read_cell
from cell.config.inputs import changes
from cell.console import Console
from cell.files.task import read_task
from cell.files.world import read_world
from cell.session.cameras import VARIABLE, device_of, open_camera, require_live
from cell.session.connection import WhichCell, open_cell, simulated_cell
from driver.emulator import Emulator
from driver.line.clock import Clock
from pictures.cameras import SERIAL
from typed.command_line import a465, replace_in
from vision.camera.basler import BaslerCamera, BaslerSettings
from vision.camera.frame_source import Image
from vision.camera.video.settings import VideoSettings

pytestmark = pytest.mark.xdist_group("camera_option")
TIME_SCALE = 4.0


@pytest.fixture(autouse=True)
def two_cameras(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PYLON_CAMEMU", "2")


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Scenes whose camera is an emulated one that sends photographs of Task 2."""
    folder = tmp_path_factory.mktemp("camera")
    shutil.copytree(data_file("scenes"), folder / "scenes")
    replace_in(folder / "scenes/task2.world.toml", "cubes = [1, 2, 3, 4]", "cubes = [3]")
    replace_in(folder / "scenes/cell.toml", "photographs = 5", "photographs = 2")
    render_step(folder / "scenes/task2.toml", None, folder / "shots", None, Console(as_json=True))
    given(
        folder / "scenes",
        f'exposure_us = 8000\nfeatures = {{ TestImageSelector = "Off", ImageFilename = "{folder / "shots"}", '
        'ImageFileMode = "On", Width = 1920, Height = 1200 }',
    )
    return folder


def given(scenes: Path, lines: str) -> None:
    replace_in(scenes / "cell.toml", "[motion]", f"[look.basler]\n{lines}\n\n[motion]")


@pytest.mark.slow
def test_a_live_look_sees_what_the_photographs_show(place: Path) -> None:
    task = place / "scenes/task2.toml"
    live, told = a465("look", task, "--camera", SERIAL, "--json")
    assert f"camera {SERIAL}: Emulation serial:0815-0000, 1920 x 1200 px, exposure 8 ms" in told
    shown = look_step(task, place / "shots", None, None, None, Console(as_json=True))
    assert json.loads(live) == json.loads(json.dumps(shown))
    boards = shown["scenes"][0]["boards"]
    assert [[hole["state"] for hole in board["holes"]].count("cube") for board in boards] == [1, 0]


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (
            ["look", "TASK", "--camera", "serial:1"],
            "no photographs: camera serial:1: not found; connected: Emulation serial:0815-0000 class:BaslerCamEmu",
        ),
        (["look", "TASK", "--camera", "colour:red"], "wrong input: camera 'colour:red': must be name:NAME, ser"),
        (["look", "TASK", "--camera", "cell"], "cell.toml names no camera; write device = ... under [look.basler]"),
        (["look", "TASK", "--camera", "x", "--images", "y"], "--images y and --camera x: give only one source"),
        (["look", "TASK", "--camera", "rtsp://me:x@h/1"], "camera 'rtsp://...': must be name:NAME, ser"),
        (["look", "TASK", "--camera", "video:rtsp://me:x@h/1", "--images", "y"], "--camera video:rtsp://***@h/1: give"),
        (["look", "--detections", "x.json", "--camera", "y"], "--camera cannot be combined with --detections"),
        (["run", "TASK", "--camera", "x"], "--camera needs --port: the simulated cell has its own camera"),
        (["run", "TASK", "--port", "/dev/none"], "--port needs a camera: name one with --camera, with A465_CAMERA"),
        (["run", "TASK", "--port", "/dev/none", "--camera", "x"], "no photographs: camera x: not found; connected"),
        (["run", "TASK", "--port", "p", "--camera", "x", "--images", "y"], "give only one source of images"),
    ],
)  # fmt: skip
def test_a_camera_that_cannot_be_had_is_told(place: Path, arguments: list[str], told: str) -> None:
    with pytest.raises(InputError) as caught:
        app(
            [str(place / "scenes/task2.toml") if a == "TASK" else a for a in arguments], standalone_mode=False
        )
    assert told in f"{caught.value.word}: {caught.value}"
    assert caught.value.exit_code == 2


def test_why_there_are_no_photographs_is_data_too(place: Path) -> None:
    task, selector = place / "scenes/task2.toml", "class:BaslerCamEmu"
    said, told = a465("look", task, "--camera", selector, "--json", code=2)
    assert told.startswith(f"a465: no photographs: camera {selector}: matches 2 cameras")
    assert len(told.splitlines()) == 1
    error = json.loads(said)["error"]
    assert (error["kind"], error["exit_code"], error["reason"]) == ("CameraError", 2, "ambiguous")
    assert [device["serial"] for device in error["found"]] == ["0815-0000", "0815-0001"]


def test_the_cell_file_says_which_camera_and_how(scenes: Path) -> None:
    plain = read_cell(scenes / "cell.toml")
    assert plain.live_camera.device is None
    assert plain.live_camera.basler == BaslerSettings()
    given(
        scenes,
        'device = "name:camera-crs93"\nexposure_us = 12000\ngain_db = 3\ntimeout_s = 1.5\nheartbeat_s = 1\n'
        "features = { ReverseX = true, GainRaw = 5 }",
    )
    cell_ = read_cell(scenes / "cell.toml")
    assert cell_.live_camera.device == "name:camera-crs93"
    assert cell_.live_camera.basler == BaslerSettings(0.012, 3.0, 1.5, 1.0, {"ReverseX": True, "GainRaw": 5})
    assert cell_.digest == plain.digest  # no plan rests on it
    assert not changes(plain.inputs, cell_.inputs)


@pytest.mark.parametrize(
    ("lines", "told"),
    [
        ('device = "colour:red"', r"look\.basler\.device = 'colour:red': must be name:NAME"),
        ('device = "cell"', r"look\.basler\.device = 'cell': must be a camera; write name:cell"),
        ("device = 7", r"look\.basler\.device = 7: must be a string"),
        ("exposure_us = 0", r"look\.basler\.exposure_us = 0: must be a number in us from 1 to"),
        ("gain_db = -1", r"look\.basler\.gain_db = -1: must be a number in dB from 0 to 60"),
        ("timeout_s = 0", r"look\.basler\.timeout_s = 0: must be a number in s"),
        ("exposure_us = 3e6", r"look\.basler\.timeout_s: must be more than the exposure, 3 s"),
        ("heartbeat_s = 0", r"look\.basler\.heartbeat_s = 0"),
        ("exposure_ms = 3", r"look\.basler\.exposure_ms = 3: is not a known key \(did you mean look\.basler\.exp"),
        ("features = { Width = [1] }", r"look\.basler\.features.*: Width must be a number, a string, true or false"),
        ("features = 3", r"look\.basler\.features = 3: must be a table"),
        ('device = "x"\n[look.video]\ndevice = "video:0"', r"look\.video\.device.*only camera, but look\.b"),
        ('[look.video]\ndevice = "video:ftp://me:x@h"', r"look\.video\.device = 'video:ftp://\.\.\.': a stream's"),
        ('device = "rtsp://me:x: y@h"', r"look\.basler\.device = 'rtsp://\.\.\.': must be name:NAME"),
        ('[look.video]\ndevice = "clip.mp4"', r"look\.video\.device = 'clip\.mp4': must be video:NUMBER"),
        ('[look.video]\ndevice = "video:clip.mp4"', r"look\.video\.device.*must be a device or a stream; a recording"),
        ("[look.video]\nexposure_us = 3e6", r"look\.video\.timeout_s: must be more than the exposure, 3 s"),
        ("[look.video]\nfeatures = { FOCUS = true }", r"look\.video\.features.*: FOCUS must be a number"),
        ("[look.video]\nlatency_s = -1", r"look\.video\.latency_s = -1: must be a number in s from 0 to 60"),
    ],
)  # fmt: skip
def test_what_is_wrong_in_the_cell_file_is_told(scenes: Path, lines: str, told: str) -> None:
    given(scenes, lines)
    with pytest.raises(InputError, match=told):
        read_cell(scenes / "cell.toml")


def test_a_video_source_of_the_cell_file_affects_no_plan(scenes: Path) -> None:
    plain = read_cell(scenes / "cell.toml")
    lines = (
        'device = "video:/dev/video2"\nsize_px = [1920, 1200]\nexposure_us = 8000\ngain = 4\nlatency_s = 0.2\n'
        'timeout_s = 1\nstamps = false\nfeatures = { FOURCC = "YUYV", FOCUS = 30 }'
    )
    replace_in(scenes / "cell.toml", "[motion]", f"[look.video]\n{lines}\n\n[motion]")
    cell_ = read_cell(scenes / "cell.toml")
    assert cell_.live_camera.device == "video:/dev/video2"
    made = VideoSettings((1920, 1200), 0.008, 4.0, 0.2, 1.0, False, {"FOURCC": "YUYV", "FOCUS": 30})
    assert cell_.live_camera.video == made
    assert cell_.digest == plain.digest
    assert not changes(plain.inputs, cell_.inputs)


@pytest.mark.parametrize(
    ("selector", "told"),
    [
        ("video:clip.mp4", "--camera video:clip.mp4: is a recording, which cannot show the present cell"),
        (
            "video:rtsp://me:secret@h/1",
            "--camera video:rtsp://***@h/1: a stream does not tell how old its frames",
        ),
        ("video:ftp://h/1", "a stream's protocol must be one of"),
    ],
)
def test_an_arm_moves_only_by_a_video_source_that_shows_the_present_cell(
    scenes: Path, tmp_path: Path, selector: str, told: str
) -> None:
    task = read_task(scenes / "task2.toml")
    where = WhichCell("/dev/none", camera=selector)
    with pytest.raises(InputError) as caught, open_cell(task, where, tmp_path / "log.jsonl"):
        pass
    assert told in str(caught.value)
    assert "secret" not in f"{caught.value} {caught.value.data}"
    assert not (tmp_path / "log.jsonl").exists()  # before anything was opened
    stated = CellCamera("video:rtsp://h/1", video=VideoSettings(latency=1.0))
    require_live(stated, "video:rtsp://h/1")


@pytest.fixture(scope="module")
def clip(place: Path) -> Path:
    """A video of the photographs of the task, compressed."""
    file = place / "clip.avi"
    images = [cv2.imread(str(shot)) for shot in sorted((place / "shots").glob("*.png"))]
    writer = cv2.VideoWriter(str(file), cv2.VideoWriter.fourcc(*"MJPG"), 10.0, images[0].shape[1::-1])
    for image in images:
        writer.write(image)
    writer.release()
    return file


@pytest.mark.slow
def test_a_look_takes_a_recording(place: Path, clip: Path) -> None:
    task = place / "scenes/task2.toml"
    said, told = a465("look", task, "--camera", f"video:{clip}", "--json")
    assert f"video:{clip}: a recording, which need not show the present cell" in told
    seen = json.loads(said)["scenes"][0]["boards"]
    assert [[hole["state"] for hole in board["holes"]].count("cube") for board in seen] == [1, 0]
    truth = {board.board.name: board for board in read_world(task.with_suffix(".world.toml"), 0.036).boards}
    for board in seen:  # compression costs little
        off = np.array(board["T_base_board"])[:3, 3] - truth[board["board"]].T_base_board[:3, 3]
        assert np.linalg.norm(off) < 0.4e-3


@contextmanager
def emulated(place: Path) -> Iterator[str]:
    """The port of a unit among the boards and cubes of the task."""
    task = read_task(place / "scenes/task2.toml")
    simulated = simulated_cell(task, None)
    with Emulator(task.cell.unit, Clock(TIME_SCALE), plant=simulated) as emulator:
        simulated.now_ms = emulator.now_ms
        yield emulator.open_pty()


def test_the_device_of_the_cell_file_looks_unless_another_is_named(place: Path, tmp_path: Path) -> None:
    shutil.copytree(place / "scenes", tmp_path / "scenes")
    replace_in(tmp_path / "scenes/cell.toml", "\n[look.basler]", f'\n[look.basler]\ndevice = "{SERIAL}"')
    task = read_task(tmp_path / "scenes/task2.toml")
    with emulated(place) as port:
        for asked, opened in ((None, SERIAL), ("cell", SERIAL), ("0815-0001", "0815-0001")):
            log = tmp_path / f"{asked}.jsonl"
            with open_cell(task, WhichCell(port, camera=asked), log) as connection:
                assert isinstance(connection.frames, BaslerCamera)
                assert str(connection.frames.selector) == opened
                assert connection.frames.grab(1)[0].shape == (1200, 1920)
            assert connection.frames.device is None
        with open_cell(task, WhichCell(port, images=place / "shots"), tmp_path / "i.jsonl") as connection:
            assert not isinstance(connection.frames, BaslerCamera)


@pytest.mark.slow
def test_a_camera_that_fails_on_the_way_stops_the_run(
    place: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(cell.session.connection, "Clock", lambda: Clock(TIME_SCALE))
    shutil.copytree(place / "scenes", tmp_path / "scenes")
    shutil.copytree(place / "shots", tmp_path / "shots")
    replace_in(tmp_path / "scenes/cell.toml", str(place / "shots"), str(tmp_path / "shots"))
    task, plan = tmp_path / "scenes/task2.toml", tmp_path / "plan.json"
    look_step(task, None, None, tmp_path / "look.json", None, Console(True), SERIAL)
    plan_step(task, tmp_path / "look.json", plan, 1.0, Console(True))
    grab, looks = BaslerCamera.grab, []

    def broken_after_one(camera: BaslerCamera, count: int) -> list[Image]:
        if looks:
            shutil.rmtree(tmp_path / "shots")
        looks.append(count)
        return grab(camera, count)

    monkeypatch.setattr(BaslerCamera, "grab", broken_after_one)
    with emulated(place) as port, pytest.raises(ExecutionStopped) as caught:
        execute_plan(plan, task, Console(), WhichCell(port, camera=SERIAL), tmp_path / "run")
    assert looks == [2, 2]
    assert f"camera {SERIAL}: 3 frames of one look were damaged" in str(caught.value)
    assert caught.value.data["reason"] == "failed"
    assert caught.value.data["state"]["counts"] == list(
        read_task(task).cell.unit.counts(read_task(task).cell.q_start)
    )
    told = capsys.readouterr()
    assert f"--port {port} --camera {SERIAL} --resume" in told.out
    assert "image 1 of 2 was damaged and is retaken" in told.err


def test_the_environment_names_a_camera_before_the_cell_file(monkeypatch: pytest.MonkeyPatch) -> None:
    live = CellCamera(device="name:of-file")
    assert device_of(live) == "name:of-file"
    assert device_of(None) is None
    monkeypatch.setenv(VARIABLE, "name:of-variable")
    assert device_of(live) == device_of(None) == "name:of-variable"


def test_a_camera_of_the_variable_is_told_as_that(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    cell_ = read_cell(data_file("scenes/cell.toml"))
    monkeypatch.setenv(VARIABLE, "/dev/video0")
    told = f"camera: /dev/video0, of {VARIABLE}\n"
    for camera, there in ((None, True), ("serial:1", False)):
        with pytest.raises(CameraError) as refused, open_camera(cell_, camera):
            pass
        assert (told in capsys.readouterr().err) == there
        assert ("for a webcam give video:/dev/video0" in str(refused.value)) == there
