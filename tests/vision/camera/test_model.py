"""The camera against OpenCV's projection, finite differences, and its file with every mistake."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from arm.errors import FileInputError, InputError
from arm.io.storage import data_file
from arm.se3 import rot_x, transform
from pictures.boards import lab_camera
from vision.camera.model import Camera, read_camera, write_camera

LAB = data_file("scenes/cameras/lab.toml")


def points_in_view(count: int = 200) -> np.ndarray:
    rng = np.random.default_rng(1)
    return rng.uniform((-0.25, -0.15, 0.8), (0.2, 0.16, 1.3), (count, 3))


def test_projection_is_opencvs() -> None:
    camera, points = lab_camera(), points_in_view()
    expected, _ = cv2.projectPoints(points, np.zeros(3), np.zeros(3), camera.K, camera.distortion)
    assert np.abs(camera.project(points) - expected.reshape(-1, 2)).max() < 1e-9


def test_intrinsics_jacobian_is_the_derivative_of_the_projection() -> None:
    camera, points = lab_camera(), points_in_view(50)
    vector = np.array([*np.diag(camera.K)[:2], *camera.K[:2, 2], *camera.distortion])

    def pixels(v: np.ndarray) -> np.ndarray:
        K = np.array([[v[0], 0.0, v[2]], [0.0, v[1], v[3]], [0.0, 0.0, 1.0]])
        return replace(camera, K=K, distortion=v[4:]).project(points)

    J = camera.intrinsics_jacobian(points)
    for i, step in enumerate(1e-6 * np.maximum(1.0, np.abs(vector))):
        ahead, behind = (pixels(vector + s * step * np.eye(9)[i]) for s in (1, -1))
        assert J[..., i] == pytest.approx((ahead - behind) / (2.0 * step), rel=1e-6, abs=1e-5)


def test_projection_from_the_base_goes_through_the_pose() -> None:
    camera = lab_camera()
    points = points_in_view(20)
    in_base = points @ camera.T_base_camera[:3, :3].T + camera.T_base_camera[:3, 3]
    assert np.abs(camera.project_base(in_base) - camera.project(points)).max() < 1e-8


def test_the_middle_of_the_table_is_in_the_image() -> None:
    u, v = lab_camera().project_base((0.46, 0.0, 0.0))
    assert 600 < u < 1400
    assert 300 < v < 900


def test_points_behind_the_camera_have_no_pixel() -> None:
    assert np.isnan(lab_camera().project([[0.1, 0.0, -1.0], [0.1, 0.0, 0.0]])).all()


def test_a_written_file_reads_back_to_the_last_bit(tmp_path: Path) -> None:
    camera = replace(
        lab_camera().at(transform(rot_x(3.0), (0.5, 0.1, 1.2))),
        calibration={"id": 'a "b"', "rms_px": 0.2, "views": [1, 2], "good": True},
    )
    write_camera(tmp_path / "camera.toml", camera)
    again = read_camera(tmp_path / "camera.toml")
    assert again.digest == camera.digest
    assert again.calibration == camera.calibration
    assert again.region is None
    part = replace(camera, region=(100.0, 50.5, 1800.0, 1100.0))
    write_camera(tmp_path / "camera.toml", part)
    assert read_camera(tmp_path / "camera.toml").region == part.region
    assert part.digest == camera.digest


def test_the_printed_pose_is_made_a_rotation() -> None:
    R = lab_camera().T_base_camera[:3, :3]
    assert np.abs(R.T @ R - np.eye(3)).max() < 1e-14


TAPED = "position_mm = [490, -10, 1190]\nlooks_at_mm = [460, 0, 60]\nright_azimuth_deg = 88.5\n"


def test_a_pose_by_tape_is_one_by_its_matrix(tmp_path: Path) -> None:
    lens, pose = LAB.read_text().split("[pose]")
    file, given = tmp_path / "camera.toml", pose.partition("[calibration]")[2]
    file.write_text(f"{lens}[pose]\n{TAPED}[calibration]{given}")
    camera = read_camera(file)
    assert camera.T_base_camera[:3, 3] == pytest.approx([0.49, -0.01, 1.19])
    assert camera.project_base([[0.46, 0.0, 0.06]])[0] == pytest.approx(camera.K[:2, 2])
    write_camera(tmp_path / "matrix.toml", camera)
    assert np.array_equal(read_camera(tmp_path / "matrix.toml").T_base_camera, camera.T_base_camera)


def test_the_digest_is_of_every_value_and_of_nothing_else() -> None:
    camera = lab_camera()
    others = [
        replace(camera, K=camera.K + np.diag([1e-9, 0, 0])),
        replace(camera, distortion=camera.distortion + 1e-12),
        replace(camera, size=(1920, 1201)),
        camera.at(camera.T_base_camera + np.eye(4)[:, :1] @ np.eye(4)[3:] * 1e-9),
    ]
    assert len({c.digest for c in [camera, *others]}) == 5
    assert replace(camera, calibration={"id": "other"}).digest == camera.digest


@pytest.mark.parametrize(
    ("old", "new", "key"),
    [
        ("[1920, 1200]", "[1920]", "intrinsics.size_px"),
        ("[1920, 1200]", "[1200, 1920]", r"are they swapped\? \[1920, 1200\]"),
        ("4746.48725, 0.0", "16.0, 0.0", r"K_px.*480 px or more; 16 px see 178 deg \(is it in mm\?"),
        (
            "1072.72375",
            "0.0",
            r"K_px.*cx, cy inside the image, 1920 x 1200 px; it is 0, 533.493 \(they count from",
        ),
        (
            "[1920, 1200]",
            "[3840, 2400]",
            r"K_px.*near the middle of 3840 x 2400 px; it is .* \(it is the middle of 2145 x 1067 px: are",
        ),
        ("533.49256", "1200.5", "intrinsics.K_px.*it is 1072.72, 1200.5"),
        ("4746.48725, 0.0", "-4746.48725, 0.0", "intrinsics.K_px"),
        (
            "[4746.48725, 0.0, 1072.72375],\n  [0.0, 4738.03233, 533.49256],\n  [0.0, 0.0, 1.0],",
            "[4746.48725, 0.0, 0.0],\n  [0.0, 4738.03233, 0.0],\n  [1072.72375, 533.49256, 1.0],",
            r"K_px = .*fx, fy above 0 \(is it transposed, as MATLAB has it\?\)",
        ),
        ("-0.21867, -1.00296, 0.00005, 0.00311, 8.29851", "8.29851, 0.0", "intrinsics.distortion"),
        ("-0.21867, -1.00296, 0.00005, 0.00311, 8.29851", "-80.0, -1, 0, 0, 0", "has no inverse"),
        ("0.02629, 0.99788, -0.05940", "0.99788, 0.02629, -0.05940", "pose.T_base_camera"),
        (
            "[0.02629, 0.99788, -0.05940, 0.49209],\n  [0.99942, -0.02495, 0.02314, -0.01471],\n"
            "  [0.02161, -0.05997, -0.99796,",
            "[0.02629, -0.99788, 0.05940, 0.49209],\n  [0.99942, 0.02495, -0.02314, -0.01471],\n"
            "  [0.02161, 0.05997, 0.99796,",
            "pose.T_base_camera.*looks 86 deg upwards, and boards are seen from above .*OpenGL",
        ),
        ("1.19294", "1192.94", "pose.T_base_camera.*1192.94 m from the base.*metres"),
        ("size_px", "size_pix", "did you mean|the file has intrinsics.size_pix"),
        ("[pose]", "region_px = [9, 0, 8, 7]\n[pose]", "intrinsics.region_px.*left < right and top < bottom"),
        pytest.param(
            "[pose]",
            f"covariance = {np.diag([-1.0, *[1.0] * 8]).tolist()}\n[pose]",
            "intrinsics.covariance: must be a covariance: 9 rows of 9 finite numbers, symmetric",
            id="covariance",
        ),
        ("[pose]", "[place]", "pose"),
        ("[calibration]", "[calibraton]", "calibraton.*not a known key"),
        ("[pose]", f"[pose]\n{TAPED}", "pose.position_mm.*must be left out where T_base_camera is given"),
    ],
)
def test_mistakes_in_the_file(tmp_path: Path, old: str, new: str, key: str) -> None:
    text = LAB.read_text()
    assert old in text
    path = tmp_path / "camera.toml"
    path.write_text(text.replace(old, new))
    with pytest.raises(FileInputError, match=key) as caught:
        read_camera(path)
    assert str(path) in str(caught.value)


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        (
            "right_azimuth_deg = 88.5\n",
            "",
            "pose.right_azimuth_deg: is missing; it belongs to position_mm",
        ),
        ("[460, 0, 60]", "[490, -10, 1190]", "pose.looks_at_mm.*gives no direction: .*its own position"),
        ("[460, 0, 60]", "[490, 500, 1190]", "pose.looks_at_mm.*the image's right side is along"),
        ("[490, -10, 1190]", "[490, -10, 21190]", "pose.position_mm.*-20000 to 20000"),
        (
            "[490, -10, 1190]",
            "[0.49, -0.01, 1.19]",
            r"pose.position_mm = \[0.49, .*from the base.*in metres\?",
        ),
        ("[460, 0, 60]", "[460, 0, 1191]", "pose.looks_at_mm.*no higher than the lens, 1190 mm.*swapped"),
        (TAPED, "", "pose.T_base_camera.*add .pose. with position_mm, looks_at_mm and right_azimuth_deg"),
    ],
)
def test_mistakes_of_a_pose_by_tape(tmp_path: Path, old: str, new: str, told: str) -> None:
    path = tmp_path / "camera.toml"
    taped = TAPED.replace("88.5", "90") if "500" in new else TAPED
    text = LAB.read_text().partition("[pose]")[0] + "[pose]\n" + taped
    assert old in text or old == TAPED
    path.write_text(text.replace(old, new))
    with pytest.raises(FileInputError, match=told):
        read_camera(path)


@pytest.mark.parametrize("shape", [(1200, 1600), (1200, 1920, 4), (1920, 1200)])
def test_an_image_of_another_size_is_refused(shape: tuple[int, ...]) -> None:
    with pytest.raises(InputError, match="photo 7") as caught:
        lab_camera().require_size(np.zeros(shape, np.uint8), "photo 7")
    assert ("sides are exchanged: was it turned by 90 deg" in str(caught.value)) == (shape == (1920, 1200))
    if len(shape) == 2:
        assert f"{shape[1]} x {shape[0]}" in str(caught.value)
        assert "1920 x 1200" in str(caught.value)


def test_arrays_cannot_be_changed() -> None:
    camera = Camera(np.eye(3), np.zeros(5), (10, 10), np.eye(4))
    with pytest.raises(ValueError, match="read-only"):
        camera.K[0, 0] = 2.0
