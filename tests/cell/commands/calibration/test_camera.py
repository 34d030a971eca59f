"""a465 calibrate camera, as a user has it: photographs in, camera file, report and verdict out."""

from __future__ import annotations

import json
import os
import shutil
import struct
import zlib
from pathlib import Path

import cv2
import numpy as np
import pytest

from arm.errors import FileInputError, InputError
from arm.io.storage import data_file
from calib.model.intrinsics import vector_of
from cell.commands.calibration.camera import LensOptions, camera_step, find_target
from cell.console import Console
from pictures.boards import lab_camera, smaller
from typed.command_line import a465, refused
from vision.camera.frame_source import read_grey
from vision.camera.model import read_camera, read_intrinsics, write_camera
from vision.targets.target import Target

pytestmark = pytest.mark.xdist_group("calibrate_camera")

VIEWS = 12


@pytest.fixture(scope="module")
def scenes(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The lab's scenes with a camera of half as many pixels: four times as fast."""
    folder = tmp_path_factory.mktemp("lens")
    shutil.copytree(data_file("scenes"), folder / "scenes")
    write_camera(folder / "scenes/cameras/lab.toml", smaller(lab_camera(), 0.5))
    return folder / "scenes"


@pytest.fixture(scope="module")
def photographs(scenes: Path) -> Path:
    """Of a target before that camera."""
    folder = scenes.parent / "photographs"
    a465("render", scenes / "task2.toml", "--target", "charuco", "--count", VIEWS, "--seed", 3, "-o", folder)
    return folder


def test_photographs_in_lens_and_report_out(photographs: Path, tmp_path: Path) -> None:
    told, _ = a465("calibrate", "camera", photographs, "-o", tmp_path / "camera.toml", "--json")
    found = json.loads(told)
    assert found["verdict"] == "accepted"
    assert len(found["views"]) == VIEWS
    assert all(view["dropped"] == [] for view in found["views"])

    lens = read_intrinsics(tmp_path / "camera.toml")
    true = smaller(lab_camera(), 0.5)
    assert lens.K.tolist() == found["K_px"]
    assert lens.lens_covariance is not None
    assert lens.lens_covariance.tolist() == found["covariance"]
    assert found["held_out_px"] != found["corner_sigma_px"]
    assert lens.calibration["held_out_px"] == pytest.approx(found["held_out_px"], abs=1e-5)
    assert lens.calibration["work_std_mm"] == pytest.approx(found["work"]["worst_std_mm"], abs=1e-5)
    off = vector_of(lens) - vector_of(true)
    assert (np.abs(off) < 4.0 * np.sqrt(np.diag(lens.lens_covariance))).all()
    text = (tmp_path / "camera.toml").read_text()
    assert text.count("[[views]]") == VIEWS

    page = (tmp_path / "camera.html").read_text()
    assert ">accepted</span>" in page
    assert "http" not in page
    assert "nan" not in page


@pytest.mark.slow
def test_the_same_photographs_give_the_same_bytes(photographs: Path, tmp_path: Path) -> None:
    for name in ("a", "b"):
        a465("calibrate", "camera", photographs, "-o", tmp_path / f"{name}.toml", own_process=name == "b")
    assert (tmp_path / "a.toml").read_bytes() == (tmp_path / "b.toml").read_bytes()
    assert (tmp_path / "a.html").read_bytes() == (tmp_path / "b.html").read_bytes()


@pytest.mark.slow
def test_a_lens_without_a_place_cannot_be_mistaken_for_a_camera(photographs: Path, tmp_path: Path) -> None:
    a465("calibrate", "camera", photographs, "-o", tmp_path / "camera.toml")
    with pytest.raises(FileInputError, match="the file has intrinsics, but no extrinsics"):
        read_camera(tmp_path / "camera.toml")
    with (tmp_path / "camera.toml").open("a") as file:
        file.write("\n[pose]\nT_base_camera = [[1,0,0,0.5],[0,-1,0,0],[0,0,-1,1.2],[0,0,0,1]]\n")
    placed = read_camera(tmp_path / "camera.toml")
    again = tmp_path / "again.toml"
    write_camera(again, placed)
    assert read_camera(again).digest == placed.digest


@pytest.mark.slow
def test_a_refusal_writes_the_report_and_no_camera(photographs: Path, tmp_path: Path) -> None:
    few = tmp_path / "few"
    few.mkdir()
    for file in sorted(photographs.iterdir())[:5]:
        shutil.copy(file, few)
    told, said = a465("calibrate", "camera", few, "-o", tmp_path / "camera.toml", "--json", code=5)
    assert json.loads(told)["verdict"] == "refused"
    assert "5 views are usable, at least 8 are needed" in said
    assert "camera.toml was not written" in said
    assert not (tmp_path / "camera.toml").exists()
    assert ">refused</span>" in (tmp_path / "camera.html").read_text()


@pytest.mark.slow
def test_held_numbers_and_options_reach_the_fit(photographs: Path, tmp_path: Path) -> None:
    told, _ = a465(
        "calibrate",
        "camera",
        photographs,
        "--hold",
        "k3",
        "--hold",
        "p1",
        "--work-mm",
        900,
        1100,
        "--work-region",
        *(100, 60, 860, 540),
        "-o",
        tmp_path / "part.toml",
        "--json",
    )
    found = json.loads(told)
    assert found["work"]["region_px"] == [100.0, 60.0, 860.0, 540.0]
    assert read_intrinsics(tmp_path / "part.toml").region == (100.0, 60.0, 860.0, 540.0)
    assert found["parameters"]["k3"] == {"value": 0.0, "std": None}
    assert [found["work"][k] for k in ("near_mm", "far_mm")] == pytest.approx([900.0, 1100.0])
    told, _ = a465("calibrate", "camera", photographs, "--limit-mm", 0.0001, "--json", code=5)
    assert "the limit is 0.0001 mm" in json.loads(told)["reasons"][0]


def test_a_target_in_cm_is_told(photographs: Path, tmp_path: Path) -> None:
    for square, marker, told in ((3, 2.2, True), (30, 22, False)):
        (tmp_path / "target.toml").write_text(
            f'kind = "charuco"\nsquares = [7, 5]\nsquare_mm = {square}\nmarker_mm = {marker}\n'
            'dictionary = "DICT_5X5_100"\n'
        )
        said, _ = a465("calibrate", "camera", photographs, "--target", tmp_path / "target.toml")
        assert ("NOTE: squares of 3 mm: is the target in cm?" in said) == told


def test_working_distances_in_cm_and_other_formats_are_told(photographs: Path, tmp_path: Path) -> None:
    said, _ = a465("calibrate", "camera", photographs, "--work-mm", 90, 120)
    assert "NOTE: --work-mm 90 120: the target was " in said
    for name in ("lens.yaml", "lens.json"):
        told = a465("calibrate", "camera", photographs, "-o", tmp_path / name, code=2)[1]
        assert f"{name}: must end in .toml, as it is TOML" in told
    told = a465(
        "calibrate", "camera", tmp_path, "--live", "--camera", "video:0", "--simulated", "a.toml", code=2
    )[1]
    assert "--camera video:0 and --simulated a.toml: give only one source of images" in told


def test_a_session_is_not_continued_with_images_of_another_size(tmp_path: Path) -> None:
    (tmp_path / "views").mkdir()
    cv2.imwrite(str(tmp_path / "views" / "old.png"), np.zeros((600, 800), np.uint8))
    task = data_file("scenes/task2.toml")
    told = a465("calibrate", "camera", tmp_path / "views", "--live", "--simulated", task, code=2)[1]
    assert "old.png: is 800 x 600 px, and the camera's images are 1920 x 1200 px; give a new folder" in told


def test_working_distances_in_metres_are_told() -> None:
    with pytest.raises(
        InputError, match=r"--work-mm \[0\.9, 1\.2\]: must be 20 mm or more: the unit is mm; are"
    ):
        LensOptions(work_mm=(0.9, 1.2)).work()
    assert LensOptions(work_mm=(900.0, 1200.0)).work() == (0.9, 1.2)


@pytest.mark.slow
def test_wrong_input_is_told_with_its_name_and_rule(photographs: Path, tmp_path: Path) -> None:
    def wrong(folder: Path, camera: str | None = None, live: bool = False, **options: object) -> str:
        with pytest.raises(InputError) as caught:
            camera_step(folder, LensOptions(**options), live, camera, None, Console(as_json=True))
        return str(caught.value)

    assert "no such folder" in wrong(tmp_path / "nowhere")
    empty = tmp_path / "empty"
    empty.mkdir()
    assert "contains no images" in wrong(empty)
    assert "--hold k9: must be one of k1, k2, p1, p2, k3" in wrong(photographs, hold=("k9",))
    assert "the nearer one first" in wrong(photographs, work_mm=(1100.0, 900.0))
    for limit in (0.0, float("inf"), float("nan")):
        assert "must be above 0 mm" in wrong(photographs, limit_mm=limit)
    assert "must be at least 8" in wrong(photographs, most_views=5)
    assert "need --live" in wrong(photographs, camera="name:x")
    assert "--live needs --camera SELECTOR (or A465_CAMERA), or --simulated TASK" in wrong(
        photographs, live=True
    )

    mixed = tmp_path / "mixed"
    mixed.mkdir()
    shutil.copy(sorted(photographs.iterdir())[0], mixed)
    cv2.imwrite(str(mixed / "zz.png"), np.zeros((100, 100), np.uint8))
    assert "is 100 x 100 px, but target-001.png is 960 x 600 px" in wrong(mixed)
    (mixed / "zz.png").write_bytes(b"no image")
    assert "zz.png: cannot be read as an image" in wrong(mixed)
    (mixed / "zz.png").unlink()

    target = tmp_path / "target.toml"
    target.write_text('squares = [7, 5]\nsquare_mm = 30\nmarker_mm = 22\ndictionary = "DICT_4X4_50"\n')
    assert "markers of DICT_5X5_50" in wrong(mixed, target=target)
    assert "is read by this command" in wrong(mixed, target=target, output=target)
    whole = wrong(mixed, work_region=(10.0, 0.0, 961.0, 600.0))
    assert "--work-region [10.0, 0.0, 961.0, 600.0]: must be left, top, right and bottom" in whole
    assert "of a part of the image of 960 x 600 px" in whole
    assert "--work-region" in wrong(mixed, work_region=(10.0, 500.0, 900.0, 400.0))
    target.write_text('squares = [7, 3]\nsquare_mm = 30\nmarker_mm = 22\ndictionary = "DICT_5X5_100"\n')
    said = wrong(mixed, target=target)
    assert "its images show more than the target (ChArUco, 7 x 3 squares of 30 mm" in said
    assert "target-001.png shows 15 markers of DICT_5X5_50 (ids 0 to 16) on a board of 7 x 5 squares" in said
    assert said.endswith("the file of --target needs squares = [7, 5]")


def test_what_is_written_is_no_photograph_no_folder_and_not_twice_the_same(
    photographs: Path, tmp_path: Path
) -> None:
    def wrong(**files: Path) -> str:
        with pytest.raises(InputError) as caught:
            camera_step(photographs, LensOptions(**files), False, None, None, Console(as_json=True))
        return str(caught.value)

    photograph = photographs / "target-001.png"
    before = photograph.read_bytes()
    assert f"--output {photograph}: has the suffix of an image" in wrong(output=photograph)
    assert f"--report {photograph}: has the suffix of an image" in wrong(report=photograph)
    assert photograph.read_bytes() == before
    assert f"--output {photographs}: is not a regular file" in wrong(output=photographs)
    assert not photographs.with_suffix(".html").exists()
    assert "is also the name of the report" in wrong(output=tmp_path / "camera.html")
    assert "is also the name of the report" in wrong(output=tmp_path / "a", report=tmp_path / "b/../a")
    assert not list(tmp_path.iterdir())


def test_a_pose_and_a_file_of_another_kind_are_not_replaced(photographs: Path, tmp_path: Path) -> None:
    """A lens alone may be calibrated again."""
    placed, cell = tmp_path / "camera.toml", tmp_path / "cell.toml"
    write_camera(placed, lab_camera())
    shutil.copy(data_file("scenes/cell.toml"), cell)
    before = placed.read_bytes(), cell.read_bytes()
    for output, told in (
        (
            placed,
            f"-o {placed}: has a [pose], which a calibration of the lens does not find, so that it would be lost",
        ),
        (cell, f"{cell}: is a cell file, and something else would replace it; give another name"),
    ):
        said = a465("calibrate", "camera", tmp_path / "none", "-o", output, code=2)[1]
        assert told in said
    assert (placed.read_bytes(), cell.read_bytes()) == before
    write_camera(placed, lab_camera(), placed=False)
    assert "none: no such folder" in a465("calibrate", "camera", tmp_path / "none", "-o", placed, code=2)[1]


def test_a_target_in_the_gripper_is_told(tmp_path: Path) -> None:
    hand = data_file("scenes/targets/hand.toml")
    told = a465("calibrate", "camera", tmp_path, "--target", hand, code=2)[1]
    assert (
        "hand.toml: is a target in the gripper, by its [hand], and a target that is held in no gripper belongs here "
        "(a465 calibrate hand-eye takes it; for the same print give a file without [hand])"
    ) in told


def test_photographs_are_read_as_the_sensor_has_them(photographs: Path, tmp_path: Path) -> None:
    image = read_grey(photographs / "target-001.png")
    coded = cv2.imencode(".jpg", image)[1].tobytes()
    # an Exif note that says: show it upside down
    note = b"Exif\0\0II*\0\x08\0\0\0\x01\0\x12\x01\x03\0\x01\0\0\0\x03\0\0\0\0\0\0\0"
    turned = tmp_path / "turned.jpg"
    turned.write_bytes(coded[:2] + b"\xff\xe1" + (len(note) + 2).to_bytes(2, "big") + note + coded[2:])
    assert np.abs(cv2.imread(str(turned), cv2.IMREAD_GRAYSCALE)[::-1, ::-1].astype(int) - image).mean() < 3.0
    assert np.abs(read_grey(turned).astype(int) - image).mean() < 3.0


def test_photographs_are_as_old_as_their_files(photographs: Path, tmp_path: Path) -> None:
    for name, when in (("target-001.png", 1_000_000.0), ("target-002.png", 1_005_000.0)):
        shutil.copy(photographs / name, tmp_path)
        os.utime(tmp_path / name, (when, when))
    photos, size = find_target(tmp_path, Target(), Console(as_json=True))
    assert [photo.taken_s for photo in photos] == [1_000_000.0, 1_005_000.0]
    assert size == (960, 600)


def test_photographs_that_are_too_large_or_too_dark_are_told(photographs: Path, tmp_path: Path) -> None:
    def wrong() -> str:
        with pytest.raises(InputError) as caught:
            camera_step(tmp_path, LensOptions(), False, None, None, Console(as_json=True))
        return str(caught.value)

    twelve_bits = read_grey(photographs / "target-001.png").astype(np.uint16) * 16
    cv2.imwrite(str(tmp_path / "a.png"), twelve_bits)
    assert "a.png shows nothing brighter than" in wrong()
    (tmp_path / "a.png").write_bytes(_header_of_png(60000, 60000))
    assert "a.png: cannot be read as an image" in wrong()


def _header_of_png(width: int, height: int) -> bytes:
    told = b"IHDR" + struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + struct.pack(">I", 13) + told + struct.pack(">I", zlib.crc32(told))


def test_a_wrong_option_is_one_line_and_exit_2(photographs: Path, tmp_path: Path) -> None:
    told = refused("calibrate", "camera", photographs, "--hold", "k9", code=2, cwd=tmp_path)
    assert "--hold k9: must be one of" in told
    told = refused("calibrate", "camera", photographs, "--hold", "k3,p1", code=2, cwd=tmp_path)
    assert told.rstrip().endswith("; repeat the option: --hold k3 --hold p1")


def test_heights_of_lifted_images_are_read_or_refused():
    lifts = LensOptions(lift=("a.png=50", "b=2.png=30.5+-0.1")).lifts(["a.png", "b=2.png"])
    assert (lifts["a.png"].height, lifts["a.png"].within) == (0.05, 0.2e-3)
    assert lifts["b=2.png"].height == pytest.approx(0.0305)
    assert lifts["b=2.png"].within == pytest.approx(1e-4)


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("a.png", "must be IMAGE=HEIGHT_MM"),
        ("c.png=5", "must name an image of the folder"),
        ("a.png=-5", "--lift a.png=-5: its height -5 must be from 0 to 999999999 mm in digits, such as 50"),
        ("a.png=nan", "its height nan must be from 0"),
        ("a.png=1e400", "its height 1e400 must be from 0"),
        (f"a.png={'9' * 40}", "its height 9999.*must be from 0"),
        ("a.png=5+--1", "its standard deviation -1 must be from 0"),
    ],
)
def test_a_wrong_lift_is_refused_by_its_value(text: str, why: str) -> None:
    with pytest.raises(InputError, match=why):
        LensOptions(lift=(text,)).lifts(["a.png"])


def test_a_wrong_lift_is_told_before_targets_are_looked_for(tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "a.png"), np.zeros((40, 60), np.uint8))
    assert (
        "--lift a.png: must be IMAGE=" in a465("calibrate", "camera", tmp_path, "--lift", "a.png", code=2)[1]
    )


@pytest.mark.parametrize(
    ("region", "why"),
    [
        (
            (500.0, 500.0, 100.0, 900.0),
            r"500.0, 100.0, 900.0\]: must be .*: left 500 must be less than right 100",
        ),
        ((100.0, 500.0, 500.0, 500.0), "top 500 must be less than bottom 500"),
        (
            (0.0, 0.0, 1.0, 1.0),
            r"must be 16 px or more wide and high: the unit is px; are these fractions\?$",
        ),
        ((0.0, 0.0, 900.0, 15.0), "16 px or more wide and high"),
    ],
)
def test_an_inverted_or_tiny_region_is_called_so(region: tuple[float, float, float, float], why: str) -> None:
    with pytest.raises(InputError, match=why):
        LensOptions(work_region=region).region((960, 600))
