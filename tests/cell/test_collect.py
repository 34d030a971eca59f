"""The arm shows a target to the camera: where it may, what it records, and what comes of it."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from arm.errors import ImpossibleError, InputError
from arm.files import data_file
from arm.se3 import angle_between
from calib.arm_recording import read_arm_recording
from cell.cellfile import read_cell
from cell.collecting import CollectOptions, recording_json, seen_corners
from cell.collectstep import collect_step
from cell.console import Console
from cell.handposes import LIMIT_MARGIN, hand_pool, nearest_order
from cell.handtarget import read_hand_target
from cell.scenery import unseen_scene
from cell.simulation import SimulatedCamera, SimulatedCell
from cell.worldfile import read_world
from command_line import a465, replace_in
from vision.camera import read_camera
from vision.target import TargetFinder

HAND = data_file("scenes/targets/hand.toml")
TRUE_OFFSETS = np.radians([0.0, 0.3, -0.3, 0.3, -0.3, 0.0])


def test_in_every_pose_of_the_pool_the_target_is_seen_whole() -> None:
    """Judged by what a rendered photograph shows, the arm in it."""
    scenes = data_file("scenes")
    cell, hand = read_cell(scenes / "cell.toml"), read_hand_target(HAND)
    robot, scene = hand.carried_by(cell.robot()), unseen_scene(cell)
    pool = hand_pool(robot, scene.bodies, cell.limits, cell.camera, hand, cell.clearance, 8, 3)
    assert len(pool.q) == 8
    assert (pool.q >= cell.limits.lower + LIMIT_MARGIN).all()
    assert (pool.q <= cell.limits.upper - LIMIT_MARGIN).all()
    assert (np.ptp(pool.q, axis=0) > np.radians(20.0)).all()
    simulated = SimulatedCell(cell, read_world(scenes / "task2.world.toml", cell.boards[0].marker_size))
    simulated.in_hand = hand
    finder = TargetFinder(hand.target)
    for q in pool.q[:4]:
        counts = cell.unit.counts(q)
        camera = SimulatedCamera(simulated, cell.camera, lambda at=counts: at, cell.dictionary)
        corners = seen_corners(camera, finder, 1)
        assert np.isfinite(corners).all()
        T = robot.T_base_tool(q) @ np.linalg.inv(robot.T_end_tool) @ hand.T_flange_target
        at = hand.target.points() @ T[:3, :3].T + T[:3, 3]
        assert np.abs(corners - cell.camera.project_base(at)).max() < 0.5


def test_a_target_that_cannot_be_shown_is_told_with_why() -> None:
    cell, hand = read_cell(data_file("scenes/cell.toml")), read_hand_target(HAND)
    robot, scene = hand.carried_by(cell.robot()), unseen_scene(cell)
    with pytest.raises(ImpossibleError, match=r"\d+ too near something") as told:
        hand_pool(robot, scene.bodies, cell.limits, cell.camera, hand, 0.6, 50, 0)
    reasons = told.value.data["reasons"]
    assert reasons["too near something"] > reasons["hidden by the arm"]
    assert told.value.data["found"] < 5


def test_the_next_pose_is_the_nearest() -> None:
    q = np.random.default_rng(0).uniform(-1.0, 1.0, (12, 6))
    order = nearest_order(np.zeros(6), q)
    assert sorted(order) == list(range(12))
    assert np.abs(q[order[0]]).max() == np.abs(q).max(axis=1).min()
    way = [np.zeros(6), *q[order]]
    for k in range(1, 12):
        left = q[order[k - 1 :]]
        assert np.abs(way[k] - way[k - 1]).max() == np.abs(left - way[k - 1]).max(axis=1).min()


@pytest.mark.parametrize(
    ("old", "new", "key"),
    [
        ("plate_mm = [108, 84, 4]", "plate_mm = [70, 84, 4]", "plate_mm"),
        ("centre_mm = [110, 0, 100]", "centre_mm = [110, 0]", "centre_mm"),
        ("[hand]", "[foot]", "hand"),
        ("square_mm = 12 ", "square_mm = 8 ", "marker_mm"),
    ],
)
def test_a_wrong_target_file_is_told_by_its_key(tmp_path: Path, old: str, new: str, key: str) -> None:
    path = tmp_path / "hand.toml"
    shutil.copy(HAND, path)
    path.chmod(0o644)
    replace_in(path, old, new)
    with pytest.raises(InputError) as told:
        read_hand_target(path)
    assert key in told.value.data["key"]


@pytest.mark.xdist_group("collect")
def test_zeros_and_camera_are_found_and_what_was_recorded_is_not_taken_again(tmp_path: Path) -> None:
    shutil.copytree(data_file("scenes"), tmp_path / "scenes")
    scenes = tmp_path / "scenes" / "uncalibrated"
    replace_in(scenes / "cell.toml", "photographs = 5", "photographs = 1")
    task, recording = scenes / "task2.toml", tmp_path / "recorded.json"
    told: list[str] = []

    class Heard(Console):
        def say(self, text: str = "") -> None:
            told.append(text)

    def collect(poses: int, folder: str) -> dict:
        return collect_step(
            recording,
            task,
            HAND,
            scenes / "calibration.toml",
            None,
            True,
            CollectOptions(poses, 1),
            None,
            None,
            None,
            None,
            1.0,
            30.0,
            tmp_path / folder,
            Heard(),
        )

    collect(8, "first")
    whole = json.loads(recording.read_text())
    assert whole["unit"] == "crs93"
    before = whole["poses"][:6]
    recording.write_text(json.dumps({**whole, "poses": before}))  # as if it had been interrupted
    (scenes / "cell.toml").write_text(
        "\n".join(x for x in (scenes / "cell.toml").read_text().splitlines() if "calibration =" not in x)
    )
    told.clear()
    result = collect(8, "second")
    assert [line for line in told if "there from before" in line]
    assert sum("corners, " in line for line in told) == 2
    assert json.loads(recording.read_text())["poses"][:6] == before
    assert result["verdict"] == "accepted", result["reasons"]
    assert np.degrees(np.abs(np.array(result["joint_offsets_rad"]) - TRUE_OFFSETS)).max() < 0.01
    true = read_camera(scenes.parent / "cameras" / "lab.toml").T_base_camera
    T = np.array(result["T_base_camera"])
    assert np.linalg.norm(T[:3, 3] - true[:3, 3]) < 2e-4
    assert np.degrees(angle_between(T[:3, :3], true[:3, :3])) < 0.02
    cell = read_cell(scenes / "cell.toml")
    assert cell.calibration is not None
    assert cell.calibration.id == result["id"]
    assert recording_json(read_arm_recording(recording)) == json.loads(recording.read_text())


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"poses": 5}, "--poses 5: must be from 8 to 300"),
        ({"seed": -1}, "--seed -1: must be 0 or more"),
        ({"output": None}, "--apply needs -o FILE"),
        ({"output": "camera"}, "camera.toml: is read by this command"),
        ({"output": "folder"}, "is no ordinary file"),
        ({"output": "task"}, "task2.toml"),
        ({"speed": 2.0}, "speed = 2"),
        ({"recording": "recorded.txt"}, "is a .json file"),
    ],
)
def test_what_cannot_be_is_refused_before_anything_opens(
    tmp_path: Path, changed: dict[str, object], words: str
) -> None:
    task = data_file("scenes/uncalibrated/task2.toml")
    output = {"output": tmp_path / "c.toml", **changed}["output"]
    with pytest.raises(InputError) as told:
        collect_step(
            tmp_path / str(changed.get("recording", "recorded.json")),
            task,
            HAND,
            {"task": task, "camera": task.parent / "camera.toml", "folder": task.parent}.get(output, output),  # type: ignore
            None,
            True,
            CollectOptions(int(changed.get("poses", 8)), int(changed.get("seed", 0))),  # type: ignore[call-overload]
            None,
            None,
            None,
            None,
            changed.get("speed"),  # type: ignore[arg-type]
            None,
            tmp_path / "run",
            Console(),
        )
    assert words in str(told.value)
    assert list(tmp_path.iterdir()) == []


def test_options_of_a_collection_go_with_it(tmp_path: Path) -> None:
    _, said = a465("calibrate", "hand-eye", "recorded.json", "--poses", "9", code=2, cwd=tmp_path)
    assert "--poses: goes with --collect TASK" in said
