"""Features of the background: where they are taken, and their file."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from arm.errors import ImpossibleError, InputError
from vision.background.features import (
    EDGE,
    FEWEST,
    MOST,
    Background,
    background_features,
    read_background,
    write_background,
)
from vision.camera.model import Camera
from watched.scratched import ScratchedTable, turned


def test_features_are_at_the_specks_and_spread(
    background: Background, table: ScratchedTable, camera: Camera
) -> None:
    specks = camera.project_base(table.points)
    off = np.linalg.norm(background.points[:, None] - specks[None], axis=-1).min(axis=1)
    assert 150 < len(background.points) <= MOST
    assert np.median(off) < 6.0  # of a block of 21 px, within which a speck may lie
    assert background.points.min() >= EDGE
    assert (np.array(camera.size) - background.points).min() >= EDGE
    halves = (background.points > np.array(camera.size) / 2.0).mean(axis=0)
    assert (np.abs(halves - 0.5) < 0.2).all()


def test_no_feature_is_taken_where_something_may_move(table: ScratchedTable, camera: Camera) -> None:
    covered = [np.array([(300, 200), (900, 250), (850, 700), (320, 640)])]
    points = background_features([table.image(camera)], camera, covered).points
    inside = (points > (320, 250)).all(axis=1) & (points < (850, 640)).all(axis=1)
    assert not inside.any()


def test_a_clean_table_is_refused(camera: Camera) -> None:
    bare = ScratchedTable(np.zeros((0, 3)), np.zeros(0), np.zeros(0))
    with pytest.raises(ImpossibleError, match=f"at least {FEWEST} are needed: clear the table") as refused:
        background_features([bare.image(camera, seed=n) for n in range(4)], camera)
    assert refused.value.data["features"] < FEWEST


def test_the_file_keeps_all_and_is_the_same_each_time(
    background: Background, camera: Camera, tmp_path: Path
) -> None:
    for name in ("a.npz", "b.npz"):
        write_background(tmp_path / name, background)
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()
    assert (tmp_path / "a.npz").stat().st_size < 400_000
    again = read_background(tmp_path / "a.npz", camera)
    np.testing.assert_array_equal(again.points, background.points)
    assert np.abs(again.patches - background.patches).max() < 0.05


def test_a_background_of_another_calibration_is_refused(
    background: Background, camera: Camera, tmp_path: Path
) -> None:
    write_background(file := tmp_path / "background.npz", background)
    for other in (turned(camera, (0, 0, 0.1)), replace(camera, K=camera.K * np.array([[1.001], [1], [1]]))):
        with pytest.raises(InputError, match="taken for another calibration"):
            read_background(file, other)


@pytest.mark.parametrize("data", [b"", b"no zip", b"PK\x03\x04 cut"])
def test_what_is_no_background_is_refused(data: bytes, camera: Camera, tmp_path: Path) -> None:
    (file := tmp_path / "background.npz").write_bytes(data)
    with pytest.raises(InputError, match="is no background; a465 calibrate background writes one"):
        read_background(file, camera)


def _arrays(background: Background, folder: Path) -> dict[str, Any]:
    write_background(file := folder / "sound.npz", background)
    with np.load(file) as data:
        return dict(data)


def _every(n: int, value: float) -> Callable[[np.ndarray], np.ndarray]:
    def changed(array: np.ndarray) -> np.ndarray:
        array = array.copy()
        array[::n] = value
        return array

    return changed


@pytest.mark.parametrize(
    ("key", "change", "said"),
    [
        ("format", lambda _: np.array(2), "format is 2, must be 1"),
        ("format", lambda _: np.array(np.inf), "format is an array"),
        ("format", lambda _: np.array([1, 1]), "format is an array"),
        ("size_px", lambda _: np.array(5), "size_px is an array"),
        ("points_px", lambda _: np.array(5.0), "points_px is an array"),
        ("points_px", lambda a: a[:, 0], "points_px is an array"),
        ("points_px", lambda a: np.hstack([a, a[:, :1]]), "points_px is an array"),
        ("points_px", lambda a: a.astype(complex), "points_px is an array"),
        ("points_px", lambda a: a[:-1], "points_px has .* and patches .* features"),
        ("points_px", lambda a: np.zeros_like(a), "points_px must be different places in the image"),
        ("points_px", _every(2, np.nan), "points_px must be different places in the image"),
        ("points_px", _every(7, 5000.0), "points_px must be different places in the image"),
        ("patches", _every(2, np.nan), "patches must have grey levels"),
        ("patches", _every(1, 0.0), "patches must have grey levels"),
        ("patches", lambda a: 1e30 * a.astype(float), "patches must have grey levels"),
        ("patches", lambda a: np.zeros((30_000, 21, 21), np.float16), "patches has more than 1000000 bytes"),
        ("camera", lambda _: np.array([None], dtype=object), "camera is an array|Object arrays"),
    ],
)
def test_a_background_with_a_wrong_array_is_refused_by_its_key(
    background: Background,
    camera: Camera,
    tmp_path: Path,
    key: str,
    change: Callable[[np.ndarray], np.ndarray],
    said: str,
) -> None:
    arrays = _arrays(background, tmp_path)
    np.savez_compressed(file := tmp_path / "background.npz", **{**arrays, key: change(arrays[key])})
    with pytest.raises(InputError, match=said):
        read_background(file, camera)


@pytest.mark.parametrize("seed", range(12))
def test_a_damaged_background_is_refused(
    background: Background, camera: Camera, tmp_path: Path, seed: int
) -> None:
    """Any bytes may be wrong: of the archive, of what is packed in it, of a header."""
    write_background(file := tmp_path / "background.npz", background)
    rng, data = np.random.default_rng(seed), bytearray(file.read_bytes())
    for at in rng.integers(0, len(data), 400):
        data[at] ^= int(rng.integers(1, 256))
    file.write_bytes(bytes(data))
    with pytest.raises(InputError, match="background"):
        read_background(file, camera)


@pytest.mark.parametrize("shape", [10**12, 10**25, -1])
def test_a_header_that_promises_too_much_reserves_nothing(
    background: Background, camera: Camera, tmp_path: Path, shape: int
) -> None:
    promised = {"descr": "<f8", "fortran_order": False, "shape": (shape, 2)}
    with zipfile.ZipFile(file := tmp_path / "background.npz", "w") as archive:
        for key, array in _arrays(background, tmp_path).items():
            data = io.BytesIO()
            if key == "points_px":
                np.lib.format.write_array_header_1_0(data, promised)
            else:
                np.lib.format.write_array(data, array)
            archive.writestr(f"{key}.npy", data.getvalue())
    with pytest.raises(InputError, match="points_px is an array"):
        read_background(file, camera)
