"""The arm shows a target to the camera: where it may, what it records, and what comes of it."""

from __future__ import annotations

import json
import shutil
import threading
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import cell.collectstep
import cell.connection
import cell.handposes
import cell.handrecipe
from arm.errors import ImpossibleError, InputError
from arm.files import data_file
from arm.se3 import Array, angle_between, rot_x, transform
from calib.arm_recording import read_arm_recording, recording_json
from cell.cellfile import read_cell
from cell.collecting import SAME_POSE, CollectOptions, others, seen_corners
from cell.collectstep import CollectFiles, collect_step
from cell.connection import WhichCell, join, simulated_cell
from cell.console import Console
from cell.foldercamera import FolderCamera
from cell.handposes import LIMIT_MARGIN, HandView, hand_pool, nearest_order
from cell.handrecipe import RISE, WRIST_STEP, recipe_poses
from cell.handrecord import HandRecord
from cell.handtarget import read_hand_target
from cell.scenery import unseen_scene
from cell.simulation import SimulatedCamera, SimulatedCell
from cell.taskfile import read_task
from cell.worldfile import read_world
from command_line import a465, replace_in
from driver.clock import Clock
from driver.emulator import Emulator
from vision.camera import read_camera
from vision.target import TargetFinder

HAND = data_file("scenes/targets/hand.toml")
TRUE_OFFSETS = np.radians([0.0, 0.3, -0.3, 0.3, -0.3, 0.0])


@pytest.fixture(scope="module")
def shown() -> HandView:
    cell, hand = read_cell(data_file("scenes/cell.toml")), read_hand_target(HAND)
    return HandView(
        hand.carried_by(cell.robot()),
        unseen_scene(cell).bodies,
        cell.limits,
        cell.camera,
        hand,
        cell.clearance,
    )


def photographed(view: HandView, q: Array) -> Array:
    """Corners (m, 2) px that a rendered photograph shows, the arm in it."""
    cell = read_cell(data_file("scenes/cell.toml"))
    world = read_world(data_file("scenes/task2.world.toml"), cell.boards[0].marker_size)
    simulated = SimulatedCell(cell, world)
    simulated.in_hand = view.hand
    counts = cell.unit.counts(q)
    camera = SimulatedCamera(simulated, cell.camera, lambda: counts, cell.dictionary)
    return seen_corners(camera, TargetFinder(view.hand.target), 1)


def require_shown_whole(view: HandView, q: Array) -> None:
    corners = photographed(view, q)
    assert np.isfinite(corners).all()
    T = view.robot.T_base_tool(q) @ np.linalg.inv(view.robot.T_end_tool) @ view.hand.T_flange_target
    at = view.hand.target.points() @ T[:3, :3].T + T[:3, 3]
    assert np.abs(corners - view.camera.project_base(at)).max() < 0.5


def test_in_every_pose_of_the_pool_the_target_is_seen_whole(shown: HandView) -> None:
    pool = hand_pool(shown, 8, 3)
    assert len(pool.q) == 8
    limits = read_cell(data_file("scenes/cell.toml")).limits
    assert (pool.q >= limits.lower + LIMIT_MARGIN).all()
    assert (pool.q <= limits.upper - LIMIT_MARGIN).all()
    assert (np.ptp(pool.q, axis=0) > np.radians(20.0)).all()
    assert all(shown.shows(q) for q in pool.q)
    for q in pool.q[:4]:
        require_shown_whole(shown, q)


def test_a_configuration_shows_the_target_only_within_limits_clear_and_facing_the_camera(
    shown: HandView,
) -> None:
    known, q = read_cell(data_file("scenes/cell.toml")), hand_pool(shown, 1, 3).q[0]

    def within(lower: Array, upper: Array) -> bool:
        limits = replace(known.limits, lower=lower - LIMIT_MARGIN, upper=upper + LIMIT_MARGIN)
        view = HandView(shown.robot, (), limits, shown.camera, shown.hand, 0.0)
        return view.shows(q)

    assert within(q - 1e-9, q + 1e-9)
    for joint in np.eye(6):
        assert not within(q - 1e-9 + 2e-9 * joint, q + 1e-9)
        assert not within(q - 1e-9, q + 1e-9 - 2e-9 * joint)
    away = replace(shown.hand, T_flange_target=shown.hand.T_flange_target @ transform(rot_x(np.pi)))
    assert not HandView(shown.robot, (), known.limits, shown.camera, away, 0.0).shows(q)


def test_the_recipe_is_rows_of_turning_wrists_at_heights_0_1_m_apart(
    shown: HandView, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cell.handrecipe, "DISTANCES", (0.71, 0.9))
    poses = recipe_poses(shown, 200, 0)
    assert poses.shape == (200, 6)
    assert len(np.unique(poses, axis=0)) == 200
    assert all(shown.shows(q) for q in poses)
    for q in poses[[0, 150]]:
        require_shown_whole(shown, q)
    heights = np.array([shown.T_base_target(q)[2, 3] for q in poses])
    means = [float(np.median(heights[part])) for part in (slice(100), slice(100, 200))]
    assert means[1] - means[0] == pytest.approx(RISE, abs=0.04)
    steps = np.diff(poses[:100], axis=0)
    wrist = steps[:, 3:] / WRIST_STEP
    together = np.ptp(wrist, axis=1) < 1e-6  # the others lean
    assert together.mean() > 0.5
    assert (np.abs(wrist[together, 0] - wrist[together, 0].round()) < 1e-6).all()
    rows = steps[together, 0] / np.radians(1.5)
    assert (np.abs(rows - rows.round()) < 1e-6).all()


def test_poses_that_the_recipe_does_not_have_are_told(
    shown: HandView, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cell.handrecipe, "DISTANCES", (0.85, 0.9))
    with pytest.raises(ImpossibleError, match="leave out --recipe") as told:
        recipe_poses(shown, 270, 0)
    assert (told.value.data["found"], told.value.data["wanted"]) == (100, 270)


def test_a_target_that_cannot_be_shown_is_told_with_why(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cell.handposes, "_MOST_BATCHES", 15)
    known, hand = read_cell(data_file("scenes/cell.toml")), read_hand_target(HAND)
    robot, scene = hand.carried_by(known.robot()), unseen_scene(known)
    view = HandView(robot, scene.bodies, known.limits, known.camera, hand, 0.6)
    with pytest.raises(ImpossibleError, match=r"\d+ too near something") as told:
        hand_pool(view, 50, 0)
    reasons = told.value.data["reasons"]
    assert reasons["too near something"] > reasons["hidden by the arm"]
    assert told.value.data["found"] < 5


def test_readings_are_by_the_units_own_zeros(tmp_path: Path) -> None:
    known = read_cell(data_file("scenes/cell.toml"))
    off = replace(known, unit=known.unit.calibrated(TRUE_OFFSETS))
    record = HandRecord(tmp_path / "recorded.json", off, read_hand_target(HAND))
    q = np.radians([10.0, -20.0, -60.0, 30.0, -40.0, 50.0])
    step = np.radians(0.01)
    assert np.abs(record.from_readings(q) - (q + TRUE_OFFSETS)).max() < step
    assert np.abs(record.to_readings(q) - (q - TRUE_OFFSETS)).max() < step


def test_poses_that_were_taken_are_not_chosen_again() -> None:
    q = np.random.default_rng(1).uniform(-1.0, 1.0, (6, 6))
    nearly = q[[1, 4]] + 0.9 * SAME_POSE
    assert np.array_equal(others(q, nearly), q[[0, 2, 3, 5]])
    assert np.array_equal(others(q, q[:0]), q)


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


class Heard(Console):
    """What a person would have read."""

    def __init__(self) -> None:
        super().__init__()
        self.told: list[str] = []

    def say(self, text: str = "") -> None:
        self.told.append(text)


@dataclass
class Collected:
    """Eight poses of the uncalibrated cell, taken once; tests work on copies."""

    scenes: Path
    recording: Path
    result: dict[str, Any]

    @property
    def files(self) -> CollectFiles:
        return CollectFiles(
            self.recording, self.scenes / "task2.toml", HAND, self.scenes / "calibration.toml"
        )


FAST = WhichCell(speed=1.0, time_scale=100.0)


@pytest.fixture(scope="module")
def once(tmp_path_factory: pytest.TempPathFactory) -> Collected:
    folder = tmp_path_factory.mktemp("collected")
    shutil.copytree(data_file("scenes"), folder / "scenes")
    collected = Collected(folder / "scenes" / "uncalibrated", folder / "recorded.json", {})
    replace_in(collected.scenes / "cell.toml", "photographs = 5", "photographs = 1")
    files = replace(collected.files, apply=True, folder=folder / "run")
    collected.result = collect_step(files, CollectOptions(8, 1), None, FAST, Heard())
    return collected


@pytest.fixture
def collected(once: Collected, tmp_path: Path) -> Collected:
    shutil.copytree(once.recording.parent, tmp_path / "copy")
    return Collected(
        tmp_path / "copy" / "scenes" / "uncalibrated", tmp_path / "copy" / "recorded.json", once.result
    )


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


@pytest.mark.xdist_group("collect")
def test_what_was_interrupted_goes_on_without_the_calibration_that_is_missing(collected: Collected) -> None:
    whole = json.loads(collected.recording.read_text())
    before = whole["poses"][:7]
    collected.recording.write_text(json.dumps({**whole, "poses": before}))
    (collected.scenes / "calibration.toml").unlink()
    console = Heard()
    result = collect_step(
        replace(collected.files, folder=collected.scenes / "run"), CollectOptions(8, 1), None, FAST, console
    )
    told = "\n".join(console.told)
    assert "begun without the cell's calibration" in told
    assert "7 poses are there from before" in told
    assert "the target is where it was" in told
    assert sum("corners, " in line for line in console.told) == 1
    assert json.loads(collected.recording.read_text())["poses"][:7] == before
    assert result["verdict"] == "accepted"
    assert read_cell(collected.scenes / "cell.toml").calibration is not None


@pytest.mark.xdist_group("collect")
def test_a_target_that_was_put_in_anew_is_told_before_anything_is_added(collected: Collected) -> None:
    world = collected.scenes / "task2.world.toml"
    replace_in(world, "seed = ", "seed = 77")
    before = collected.recording.read_bytes()
    files = replace(collected.files, folder=collected.scenes / "run")
    with pytest.raises(ImpossibleError, match="it was put in anew") as told:
        collect_step(files, CollectOptions(9, 1), None, FAST, Heard())
    assert told.value.data["off_px"] > 2.0
    assert collected.recording.read_bytes() == before


@pytest.mark.xdist_group("collect")
def test_nothing_opens_for_a_recording_that_is_complete(collected: Collected) -> None:
    console = Heard()
    nowhere = replace(FAST, port="/dev/none", time_scale=None)
    result = collect_step(collected.files, CollectOptions(8, 1), None, nowhere, console)
    assert any("so nothing moves" in line for line in console.told)
    assert result["folder"] is None
    assert result["id"] == collected.result["id"]


@pytest.mark.xdist_group("collect")
def test_the_arm_behind_a_port_is_collected_from_with_photographs_of_a_folder(
    collected: Collected, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = json.loads(collected.recording.read_text())
    collected.recording.write_text(json.dumps({**whole, "poses": whole["poses"][:7]}))
    task = read_task(collected.scenes / "task2.toml")
    simulated, clock, shots = simulated_cell(task, None), Clock(30.0), collected.scenes / "shots"
    simulated.hold(read_hand_target(HAND))
    monkeypatch.setattr(cell.connection, "Clock", lambda: clock)  # the client's clock runs as the unit's
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
                None,
                WhichCell(port=emulator.open_pty(), images=shots, speed=1.0),
                Heard(),
            )
        finally:
            over.set()
            thread.join(10.0)
    assert result["verdict"] == "accepted"
    assert len(json.loads(collected.recording.read_text())["poses"]) == 8
    assert np.degrees(np.abs(np.array(result["joint_offsets_rad"]) - TRUE_OFFSETS)).max() < 0.01


@pytest.fixture
def no_choice(monkeypatch: pytest.MonkeyPatch) -> None:
    """Poses take long to choose: whoever gets there has seen all that can be seen before."""

    def chosen(*_: object) -> None:
        raise RuntimeError("poses are chosen")

    monkeypatch.setattr(cell.collectstep, "choose", chosen)


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"poses": 5}, "--poses 5: must be from 8 to 300"),
        ({"seed": -1}, "--seed -1: must be 0 or more"),
        ({"output": None}, "--apply needs -o FILE"),
        ({"output": "camera"}, "camera.toml: is read by this command"),
        ({"output": "folder"}, "is no ordinary file"),
        ({"output": "task"}, "task2.toml: is read by this command"),
        ({"output": "world"}, "task2.world.toml: is read by this command"),
        ({"output": "board"}, "so it is not written over"),
        ({"output": "urdf"}, "a465.urdf: is there and is no calibration"),
        ({"output": "recording"}, "recorded.json: is the recording's name too"),
        ({"step": 6.0}, "--encoder-step-deg 6: must be from 0 to 5 deg"),
        ({"speed": 2.0}, "--speed 2: must be from 0.01 to 1"),
        ({"recording": "recorded.txt"}, "is a .json file"),
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
        named.get(output, output),  # type: ignore[call-overload]
        None,
        True,
        tmp_path / "run",
    )
    where = WhichCell(speed=changed.get("speed"))  # type: ignore[arg-type]

    def asked() -> None:
        options = CollectOptions.of(changed.get("poses", 8), changed.get("seed"), False)  # type: ignore[arg-type]
        collect_step(files, options, None, where, Console(), changed.get("step"))  # type: ignore[arg-type]

    with pytest.raises(InputError) as told:
        asked()
    assert words in str(told.value)
    assert list(tmp_path.iterdir()) == []


def test_options_of_a_collection_go_with_it(tmp_path: Path) -> None:
    _, said = a465("calibrate", "hand-eye", "recorded.json", "--poses", "9", code=2, cwd=tmp_path)
    assert "--poses: goes with --collect TASK" in said


@pytest.mark.parametrize(
    ("where", "words"),
    [
        (WhichCell(time_scale=0.0), "time scale = 0: must be from 0.01 to 100"),
        (WhichCell(port="/dev/none", time_scale=2.0), "--time-scale 2 is of the simulated cell"),
        (WhichCell(images=Path("shots")), "--images needs --port"),
        (WhichCell(camera="name:a"), "--camera needs --port"),
        (WhichCell(port="/dev/none", images=Path("shots"), camera="name:a"), "two places for photographs"),
        (WhichCell(port="/dev/none", images=Path("not there")), "not there: there is no such folder"),
        (WhichCell(port="/dev/none", camera="colour:red"), "colour"),
        (WhichCell(port="/dev/none"), "a camera is needed with --port"),
        (WhichCell(port="/dev/none", camera="cell"), "camera"),
        (WhichCell(world=Path("not there.toml")), "there is no such world file"),
        (WhichCell(speed=2.0), "--speed 2: must be from 0.01 to 1"),
    ],
)
def test_where_the_poses_are_taken_is_seen_before_any_is_chosen(
    no_choice: None, tmp_path: Path, where: WhichCell, words: str
) -> None:
    files = CollectFiles(tmp_path / "recorded.json", data_file("scenes/uncalibrated/task2.toml"), HAND)
    with pytest.raises(InputError) as told:
        collect_step(files, CollectOptions(8), None, where, Heard())
    assert words in str(told.value)


def test_a_folder_that_holds_something_is_refused_before_poses_are_chosen(
    no_choice: None, tmp_path: Path
) -> None:
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / "plan.json").touch()
    task = data_file("scenes/uncalibrated/task2.toml")
    files = CollectFiles(tmp_path / "recorded.json", task, HAND, folder=tmp_path / "run")
    with pytest.raises(InputError, match="new or empty folder"):
        collect_step(files, CollectOptions(8), None, FAST, Heard())
    with pytest.raises(RuntimeError, match="poses are chosen"):
        collect_step(replace(files, folder=None), CollectOptions(8), None, FAST, Heard())


@pytest.fixture
def small(tmp_path: Path) -> HandRecord:
    """A recording of eight poses that nobody has looked at."""
    record = HandRecord(
        tmp_path / "recorded.json",
        read_cell(data_file("scenes/uncalibrated/cell.toml")),
        read_hand_target(HAND),
    )
    for number in range(8):
        record.add(*taken(record, number))
    return record


def taken(record: HandRecord, number: int) -> tuple[tuple[int, ...], Array]:
    corners = len(record.hand.target.points())
    return (100 * number,) * 6, np.random.default_rng(number).uniform(10.0, 900.0, (corners, 2))


def test_a_recording_that_somebody_else_changed_is_not_written_over(small: HandRecord) -> None:
    other = HandRecord(small.file, small.cell, small.hand)
    assert len(other) == 8
    other.add(*taken(other, 8))
    changed = small.file.read_bytes()
    with pytest.raises(InputError, match=r"recorded\.json: was changed by somebody else") as told:
        small.add(*taken(small, 9))
    assert "the same command goes on" in str(told.value)
    assert small.file.read_bytes() == changed
    assert len(small) == 8
    other.add(*taken(other, 10))
    assert len(HandRecord(small.file, small.cell, small.hand)) == 10


def test_a_recording_that_came_or_went_meanwhile(small: HandRecord) -> None:
    there = small.file.read_bytes()
    small.file.unlink()
    new = HandRecord(small.file, small.cell, small.hand)
    small.file.write_bytes(there)
    with pytest.raises(InputError, match="was changed by somebody else"):
        new.add(*taken(new, 9))
    assert small.file.read_bytes() == there
    small.file.unlink()
    small.add(*taken(small, 9))  # nobody's work is lost, and all that was taken is whole again
    assert len(HandRecord(small.file, small.cell, small.hand)) == 9


def test_the_estimator_gets_all_that_a_collection_was_asked_for(
    small: HandRecord, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[tuple[Any, ...]] = []

    def solved(*given: Any) -> dict[str, Any]:
        asked.append(given)
        return {"reasons": []}

    monkeypatch.setattr(cell.collectstep, "solve_hand_eye", solved)
    task = data_file("scenes/uncalibrated/task2.toml")
    output, step = tmp_path / "c.toml", ("--encoder-step-deg", "0.5")
    command = ("calibrate", "hand-eye", small.file, "--collect", task, "--poses", "8", "--limit-mm", "0.7")
    a465(*command, "-o", output, *step)
    a465(*command, "-o", output, "--apply")
    (with_step, without) = asked
    assert with_step[3].held_out == pytest.approx(0.7e-3)
    assert with_step[4] == pytest.approx(np.radians(0.5))
    assert with_step[6:8] == (task.parent / "cell.toml", False)
    assert without[4] is None
    assert without[6:8] == (task.parent / "cell.toml", True)
