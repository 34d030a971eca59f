"""The arm shows a target to the camera: where it may, what it records, and what comes of it."""

from __future__ import annotations

import json
import shutil
import threading
from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import cell.collect.pose_pool
import cell.collect.recipe_270
import cell.commands.calibration.collect
import cell.session.connection
from arm.errors import ImpossibleError, InputError
from arm.io.storage import data_file
from arm.se3 import angle_between
from calib.hand_eye.calibrate import HAND_EYE_LIMITS
from calib.recordings.arm import read_arm_recording, recording_json
from cell.collect.collector import SAME_POSE, CollectOptions, Collector, not_taken
from cell.collect.pose_pool import HandView, hand_pool, nearest_order
from cell.collect.record import HandRecord
from cell.commands.calibration.chain import ChainOptions
from cell.commands.calibration.collect import CollectFiles, collect_step
from cell.config.cell_file import read_cell
from cell.console import Console
from cell.files.hand_target import read_hand_target
from cell.files.task import read_task
from cell.scene.build import unseen_scene
from cell.session.connection import WhichCell, join, simulated_cell
from cell.sim.photo_folder import FolderCamera
from driver.emulator import Emulator
from driver.line.clock import Clock
from pictures.seen_targets import photograph
from tasks.collecting import FAST
from typed.command_line import a465, replace_in
from typed.heard import Heard
from vision.camera.model import Image, read_camera
from vision.targets.target import Target

HAND = data_file("scenes/targets/hand.toml")

TRUE_OFFSETS = np.radians([0.0, 0.3, -0.3, 0.3, -0.3, 0.0])


@pytest.mark.slow
def test_a_target_that_cannot_be_shown_is_told_with_why(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cell.collect.pose_pool, "_MOST_BATCHES", 15)
    known, hand = read_cell(data_file("scenes/cell.toml")), read_hand_target(HAND)
    robot, scene = hand.carried_by(known.robot()), unseen_scene(known)
    view = HandView(robot, scene.bodies, known.limits, known.camera, hand, 0.6)
    with pytest.raises(ImpossibleError, match=r"\d+ too near something") as told:
        hand_pool(view, 50, 0)
    reasons = told.value.data["reasons"]
    assert reasons["too near something"] > reasons["hidden by the arm"]
    assert told.value.data["found"] < 5


def test_poses_that_were_taken_are_not_chosen_again() -> None:
    q = np.random.default_rng(1).uniform(-1.0, 1.0, (6, 6))
    nearly = q[[1, 4]] + 0.9 * SAME_POSE
    assert np.array_equal(not_taken(q, nearly), q[[0, 2, 3, 5]])
    assert np.array_equal(not_taken(q, q[:0]), q)


class Still:
    """A run of an arm at rest whose camera has one image, and its recording, which stays empty."""

    def __init__(self, image: Image, target: Target) -> None:
        mars = SimpleNamespace(link=SimpleNamespace(wait=lambda s: None), settled_counts=lambda: (0,) * 6)
        frames = SimpleNamespace(grab=lambda count: [image] * count)
        self.connection = SimpleNamespace(mars=mars, frames=frames)
        self.task = SimpleNamespace(cell=SimpleNamespace(photographs=1))
        self.hand = SimpleNamespace(target=target)

    def __len__(self) -> int:
        return 0


@pytest.mark.parametrize(
    ("target", "said"),
    [
        (Target(rows=3), r"more than the target .* 17 markers .* needs squares = \[7, 5\]"),
        (Target(columns=8), r"5 of 5 poses do not show .*; the last image shows 17 markers .*\[7, 5\]"),
    ],
    ids=["in part", "not at all"],
)
def test_a_hand_target_of_another_print_is_named(
    monkeypatch: pytest.MonkeyPatch, target: Target, said: str
) -> None:
    monkeypatch.setattr(Collector, "_drive", lambda *_: True)
    still: Any = Still(photograph(Target(), 4)[0], target)
    with pytest.raises(InputError, match=said):
        Collector(still, still, still, None, Console(as_json=True)).collect(np.zeros((9, 6)), False)


def test_the_next_pose_is_the_nearest() -> None:
    q = np.random.default_rng(0).uniform(-1.0, 1.0, (12, 6))
    order = nearest_order(np.zeros(6), q)
    assert sorted(order) == list(range(12))
    assert np.abs(q[order[0]]).max() == np.abs(q).max(axis=1).min()
    way = [np.zeros(6), *q[order]]
    for k in range(1, 12):
        left = q[order[k - 1 :]]
        assert np.abs(way[k] - way[k - 1]).max() == np.abs(left - way[k - 1]).max(axis=1).min()


@dataclass
class Collected:
    """Eight poses of the uncalibrated cell, taken once; tests work on copies."""

    scenes: Path
    recording: Path
    result: dict[str, Any]

    @property
    def files(self) -> CollectFiles:
        return CollectFiles(self.recording, self.scenes / "task2.toml", HAND)

    @property
    def options(self) -> ChainOptions:
        return ChainOptions(self.scenes / "calibration.toml")


@pytest.fixture(scope="module")
def once(tmp_path_factory: pytest.TempPathFactory) -> Collected:
    folder = tmp_path_factory.mktemp("collected")
    shutil.copytree(data_file("scenes"), folder / "scenes")
    collected = Collected(folder / "scenes" / "uncalibrated", folder / "recorded.json", {})
    replace_in(collected.scenes / "cell.toml", "photographs = 5", "photographs = 1")
    files = replace(collected.files, apply=True, folder=folder / "run")
    collected.result = collect_step(files, CollectOptions(8, 1), collected.options, FAST, Heard())
    return collected


@pytest.fixture
def collected(once: Collected, tmp_path: Path) -> Collected:
    shutil.copytree(once.recording.parent, tmp_path / "copy")
    return Collected(
        tmp_path / "copy" / "scenes" / "uncalibrated", tmp_path / "copy" / "recorded.json", once.result
    )


@pytest.mark.slow  # a whole collection
@pytest.mark.xdist_group("collect")
def test_zeros_and_camera_are_found_and_the_cell_has_them(collected: Collected) -> None:
    result = collected.result
    assert result["verdict"] == "accepted", result["reasons"]
    assert np.degrees(np.abs(np.array(result["joint_offsets_rad"]) - TRUE_OFFSETS)).max() < 0.01
    true = read_camera(collected.scenes.parent / "cameras" / "lab.toml").T_base_camera
    T = np.array(result["T_base_camera"])
    assert np.linalg.norm(T[:3, 3] - true[:3, 3]) < 2e-4
    assert np.degrees(angle_between(T[:3, :3], true[:3, :3])) < 0.02
    known = read_cell(collected.scenes / "cell.toml")
    assert known.calibration is not None
    assert known.calibration.id == result["id"]
    written = json.loads(collected.recording.read_text())
    assert written["unit"] == "crs93"
    assert recording_json(read_arm_recording(collected.recording)) == written
    more = np.array([pose["joints_rad"] for pose in result["next_poses"]])
    assert len(more) == 3
    hand = read_hand_target(HAND)
    view = HandView(
        hand.carried_by(known.robot()),
        unseen_scene(known).bodies,
        known.limits,
        known.camera,
        hand,
        known.clearance,
    )
    for q in more:
        at = known.unit.positions(known.nominal_unit.counts(q))
        assert view.obstacle(at) is None
        T = view.T_base_target(at)
        pixels = known.camera.project_base(hand.target.points() @ T[:3, :3].T + T[:3, 3])
        assert ((pixels > 0.0) & (pixels < known.camera.size)).all()


@pytest.mark.slow  # a whole collection
@pytest.mark.xdist_group("collect")
def test_what_was_interrupted_goes_on_without_the_calibration_that_is_missing(collected: Collected) -> None:
    whole = json.loads(collected.recording.read_text())
    before = whole["poses"][:7]
    collected.recording.write_text(json.dumps({**whole, "poses": before}))
    (collected.scenes / "calibration.toml").unlink()
    console = Heard()
    result = collect_step(
        replace(collected.files, folder=collected.scenes / "run"),
        CollectOptions(8, 1),
        collected.options,
        FAST,
        console,
    )
    told = "\n".join(console.told)
    assert "started without the cell's calibration" in told
    assert "continuing with 7 recorded poses" in told
    assert "the target is where it was" in told
    assert sum("corners, " in line for line in console.told) == 1
    assert json.loads(collected.recording.read_text())["poses"][:7] == before
    assert result["verdict"] == "accepted"
    assert read_cell(collected.scenes / "cell.toml").calibration is not None


@pytest.mark.slow  # a whole collection
@pytest.mark.xdist_group("collect")
def test_a_target_that_was_put_in_anew_is_told_before_anything_is_added(collected: Collected) -> None:
    world = collected.scenes / "task2.world.toml"
    replace_in(world, "seed = ", "seed = 77")
    before = collected.recording.read_bytes()
    files = replace(collected.files, folder=collected.scenes / "run")
    with pytest.raises(ImpossibleError, match="it was remounted") as told:
        collect_step(files, CollectOptions(9, 1), collected.options, FAST, Heard())
    assert told.value.data["off_px"] > 2.0
    assert collected.recording.read_bytes() == before


@pytest.mark.slow  # a whole collection
@pytest.mark.xdist_group("collect")
def test_nothing_opens_for_a_recording_that_is_complete(collected: Collected) -> None:
    console = Heard()
    nowhere = replace(FAST, port="/dev/none", time_scale=None)
    result = collect_step(collected.files, CollectOptions(8, 1), collected.options, nowhere, console)
    assert any("so nothing moves" in line for line in console.told)
    assert result["folder"] is None
    assert result["id"] == collected.result["id"]


@pytest.mark.slow  # a whole collection
@pytest.mark.xdist_group("collect")
def test_the_arm_behind_a_port_is_collected_from_with_photographs_of_a_folder(
    collected: Collected, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = json.loads(collected.recording.read_text())
    collected.recording.write_text(json.dumps({**whole, "poses": whole["poses"][:7]}))
    task = read_task(collected.scenes / "task2.toml")
    simulated, clock, shots = simulated_cell(task, None), Clock(30.0), collected.scenes / "shots"
    simulated.hold(read_hand_target(HAND))
    monkeypatch.setattr(
        cell.session.connection, "Clock", lambda: clock
    )  # the client's clock runs as the unit's
    over = threading.Event()
    with Emulator(task.cell.nominal_unit, clock, plant=simulated) as emulator:
        camera = FolderCamera(simulated, join(simulated, emulator), emulator, shots)

        def photograph() -> None:
            while not over.wait(0.05):
                camera.poll()

        thread = threading.Thread(target=photograph)
        thread.start()
        try:
            result = collect_step(
                replace(collected.files, folder=collected.scenes / "run"),
                CollectOptions(8, 1),
                collected.options,
                WhichCell(port=emulator.open_pty(), images=shots, speed=1.0),
                Heard(),
            )
        finally:
            over.set()
            thread.join(600.0)
    assert result["verdict"] == "accepted"
    assert len(json.loads(collected.recording.read_text())["poses"]) == 8
    assert np.degrees(np.abs(np.array(result["joint_offsets_rad"]) - TRUE_OFFSETS)).max() < 0.01


def test_the_estimator_gets_all_that_a_collection_was_asked_for(
    small: HandRecord, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[tuple[Any, ...]] = []

    def solved(*given: Any) -> dict[str, Any]:
        asked.append(given)
        return {"reasons": []}

    monkeypatch.setattr(cell.commands.calibration.collect, "solve_hand_eye", solved)
    task = data_file("scenes/uncalibrated/task2.toml")
    output, step = tmp_path / "c.toml", ("--encoder-step-deg", "0.5")
    command = ("calibrate", "hand-eye", small.file, "--collect", task, "--poses", "8", "--limit-mm", "0.7")
    a465(*command, "-o", output, *step)
    a465(*command, "-o", output, "--apply")
    with_step, without = (given[2] for given in asked)
    assert with_step.limits(HAND_EYE_LIMITS).held_out == pytest.approx(0.7e-3)
    assert with_step.encoder_step() == pytest.approx(np.radians(0.5))
    assert (with_step.cell, with_step.apply) == (task.parent / "cell.toml", False)
    assert without.encoder_step() is None
    assert (without.cell, without.apply) == (task.parent / "cell.toml", True)
