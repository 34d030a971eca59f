"""Every key of every kind of file with values of other types: read, or refused in one line, and never a traceback.

Each key gets a few types, drawn by a seed; docs/testing.md says how all of them are tried.
"""

from __future__ import annotations

import copy
import json
import os
import random
import shutil
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from arm.calibration_file import read_arm_calibration
from arm.controller.unit import load_unit
from arm.errors import MOST_MESSAGE, A465Error
from arm.io.node import Node
from arm.io.storage import data_file, read_text
from arm.plan_file import read_plan
from calib.nao.chain import NaoUnknowns
from calib.nao.recording import read_nao_recording
from calib.recordings.arm import read_arm_recording, write_arm_recording
from cell.config.arm_file import read_arm_file
from cell.config.cell_file import read_cell
from cell.config.fixed_tool import read_fixed_tool
from cell.config.plain_board import read_board
from cell.export.scene import surroundings_of_plan
from cell.export.urdf import describe
from cell.files.hand_target import read_hand_target
from cell.files.observation import read_observation
from cell.files.pose_list import read_pose_list
from cell.files.scene import read_scene_file
from cell.files.task import read_task
from cell.files.world import read_world
from cell.program.points import read_wire
from cell.program.program_file import read_program
from cell.task.plan_matches import require_match, require_scene, require_start_at, scene_of_now
from driver.emulator.faults.file import read_faults
from pictures.boards import lab_board, lab_camera, random_pose, seen_corners
from plan.program.stated_arm import stated_options
from plans.other_arms import scara_files, six_joints
from recorded.arm_sets import TARGETS, draw_truth, recorded, wide
from recorded.nao import as_json, nao_recording
from recorded.sets import recorded_set
from typed.any_type import JSON, TOML, keys_of, with_value, without
from typed.whole_files import whole_camera, whole_cell, whole_world
from vision.camera.model import read_camera
from vision.markers.recorded import read_detections
from vision.targets.target import read_target

pytestmark = pytest.mark.xdist_group("any_type")
EVERY = os.environ.get("A465_EVERY_TYPE") == "1"  # about 20 minutes
TYPES = 2  # of each key otherwise

TOMLS: dict[str, Callable[[Path], object]] = {
    "cell.toml": read_cell,
    "task1.toml": read_task,
    "task2.toml": read_task,
    "task2.world.toml": lambda path: read_world(path, 0.036),
    "cameras/lab.toml": read_camera,
    "calibration.toml": read_arm_calibration,
    "targets/hand.toml": read_hand_target,
    "target.toml": read_target,
    "crs93.toml": load_unit,
    "faults/bad-day.toml": read_faults,
    "fixtures/mesh.toml": read_scene_file,
    "scara.toml": read_arm_file,
    "hoop/seen.toml": read_program,
    "hoop/wires/d.toml": read_wire,
    "hoop/boards/puzzle_01-02.toml": lambda path: read_board(path, 0.036),
    "hoop/tools/hoop.toml": lambda path: read_fixed_tool(Node.of_toml(path)),
    "pen/drawing.toml": read_program,
}


@pytest.fixture(scope="module")
def whole(planned_scenes: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The shipped scenes with every key, a unit, a target, a look and a plan; no test may change them."""
    folder = Path(shutil.copytree(planned_scenes, tmp_path_factory.mktemp("whole") / "scenes"))
    shutil.copytree(folder, folder.parent / "plain")
    whole_cell(folder)
    whole_camera(folder)
    whole_world(folder)
    shutil.copy(data_file("urdf/a465/crs93.toml"), folder / "crs93.toml")
    scara_files(folder)
    hand = (folder / "targets/hand.toml").read_text()
    (folder / "target.toml").write_text(hand[: hand.index("[hand]")])
    return folder


def _refusals(whole: Any, name: str, others: tuple[Any, ...], read: Callable[[Any], object]) -> int:
    """How many spoilt copies of a file are refused."""
    draw, refusals, longest = random.Random(name), 0, 0
    for key in keys_of(whole):
        for value in others if EVERY else draw.sample(others, 1 if name == "plan" else TYPES):
            try:
                read(with_value(whole, key, value))
            except A465Error as error:
                refusals += 1
                longest = max(longest, len(str(error)))
            except Exception as error:
                raise AssertionError(f"{name}: {key} = {value!r}: {type(error).__name__}: {error}") from error
    assert longest <= MOST_MESSAGE
    return refusals


@pytest.mark.slow
@pytest.mark.parametrize("name", TOMLS)
def test_toml(whole: Path, name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    path, parse = whole / name, tomllib.loads
    text = read_text(path)

    def read(spoilt: Any) -> None:
        monkeypatch.setattr(tomllib, "loads", lambda t: copy.deepcopy(spoilt) if t == text else parse(t))
        TOMLS[name](path)

    TOMLS[name](path)
    assert _refusals(parse(text), name, TOML, read)


def _recording(folder: Path) -> None:
    rng = np.random.default_rng(1)
    truth = draw_truth(rng)
    write_arm_recording(
        folder / "arm.json", recorded(truth, wide(truth, TARGETS["marker"], 6, rng), "marker", rng)
    )


def _detections() -> dict[str, Any]:
    rng, board, camera = np.random.default_rng(1), lab_board(marker_size=0.040), lab_camera()
    T = random_pose(rng, 7.0)
    return recorded_set(board, camera, [(seen_corners(board, T, camera, rng, noise_px=0.1), T)], 0.1)


POSES = {
    "frame": "tool",
    "angles": "deg",
    "lengths": "mm",
    "entries": [
        {"name": "a", "q_deg": [0, 0, 0, 0, 0, 0]},
        {"name": "b", "T_base_tool": [[1, 0, 0, 400], [0, 1, 0, 0], [0, 0, 1, 300], [0, 0, 0, 1]]},
        [0, 0, 0, 0, 0, 0],
    ],
}


@pytest.mark.slow
@pytest.mark.parametrize("name", ["look", "plan", "plan of an arm", "poses", "detections", "arm", "nao"])
def test_json(whole: Path, tmp_path: Path, name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    plain = whole.parent / "plain"  # which the plan was made for
    task = read_task(plain / "task2.toml")
    seen = read_observation(plain / "look.json", task.cell)

    def judge_plan(path: Path) -> None:
        plan = read_plan(path)
        surroundings_of_plan(path, plan, task)
        require_match(task, plan)
        scene_of_now(task, plan)
        require_start_at(task, plan)
        require_scene(task, plan, seen)

    def judge_plan_of_an_arm(path: Path) -> None:
        plan = read_plan(path)
        describe(surroundings_of_plan(path, plan, None))
        stated_options(path, plan)

    file, reader = tmp_path / "file.json", read_nao_recording
    match name:
        case "look":
            content, reader = (
                json.loads(read_text(plain / "look.json")),
                lambda p: read_observation(p, task.cell),
            )
        case "plan":
            content, reader = json.loads(read_text(plain / "plan.json")), judge_plan
            steps = content["steps"]
            monkeypatch.setattr(
                "cell.task.plan_matches._require_placed", lambda *_: None
            )  # of a plan that is cut short
            content["steps"] = [next(s for s in steps if s["step"] == kind) for kind in ("move", "gripper")]
        case "plan of an arm":
            content = json.loads(six_joints(tmp_path).plan().to_json())
            content["steps"] = content["steps"][:1]
            content["task"] = {}
            reader = judge_plan_of_an_arm
        case "poses":
            content, reader = POSES, read_pose_list
        case "detections":
            content, reader = _detections(), read_detections
        case "arm":
            _recording(tmp_path)
            content, reader = json.loads(read_text(tmp_path / "arm.json")), read_arm_recording
        case "nao":
            content = as_json(nao_recording(1, NaoUnknowns(), 2)[0])

    def read(spoilt: Any) -> None:
        file.write_text(json.dumps(spoilt))
        reader(file)

    read(content)
    assert _refusals(content, name, JSON, read)
    for key in keys_of(content):
        try:
            read(without(content, key))
        except A465Error:
            continue


@pytest.mark.slow
@pytest.mark.parametrize("value", [None, True, 7, -1.5, "", "01-02", [], {}, ["01-02/1"], {"to": "01-02/1"}])
@pytest.mark.parametrize("key", ["cube", "from", "to"])
def test_what_a_whole_plan_says_of_a_cube(whole: Path, tmp_path: Path, key: str, value: Any) -> None:
    task = read_task(whole.parent / "plain" / "task2.toml")
    content = json.loads(read_text(whole.parent / "plain" / "plan.json"))
    content["task"]["cubes"][0][key] = value
    (tmp_path / "plan.json").write_text(json.dumps(content))
    with pytest.raises(A465Error):
        scene_of_now(task, read_plan(tmp_path / "plan.json"))
