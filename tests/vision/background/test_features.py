"""Features of the background: where they are taken, and their file."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

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
    with pytest.raises(InputError, match="is no background"):
        read_background(file, camera)
