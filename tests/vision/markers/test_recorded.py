"""Recorded corners: read as they are, judged scene by scene, and never by what else stands in the file."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from arm.errors import FileInputError
from recorded.marker_files import recorded, written
from vision.markers.recorded import read_detections


def _set(*path: str | int, to: Any) -> Callable[[dict[str, Any]], None]:
    def change(content: Any) -> None:
        for key in path[:-1]:
            content = content[key]
        content[path[-1]] = to

    return change


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (_set("camera", to=3), "camera = 3: must be a table"),
        (
            _set("camera", "K_px", to=[[1, 2], [3, 4]]),
            "camera.K_px: must be 3 rows of 3 finite numbers in px",
        ),
        (_set("camera", "K_px", 0, 0, to=-1.0), "camera.K_px: must be [[fx, skew, cx]"),
        (
            _set("camera", "size_px", to=[1920.5, 1200]),
            "camera.size_px = [1920.5, 1200]: must be width and height",
        ),
        (_set("board", "markers", to=[]), "board.markers = []: must have two markers, not 0"),
        (_set("board", "markers", 1, "id", to=1), "board.markers[1].id = 1: must differ"),
        (_set("board", "markers", 0, "corners_m", 0, 0, to=0.5), "must be two squares of one size"),
        (
            _set("board", "holes_m", to=[[0, 0, 0]]),
            "board.holes_m = [[0, 0, 0]]: must be 4 rows of 3 finite numbers",
        ),
        (_set("scenes", to={}), "scenes = {}: must be a list"),
        (_set("scenes", 2, "frames", to=[]), "scenes[2].frames = []: must have at least one image"),
        (
            _set("scenes", 1, "frames", 3, "markers", 0, "id", to=1.5),
            "scenes[1].frames[3].markers[0].id = 1.5: must be",
        ),
        (
            _set("scenes", 1, "frames", 3, "markers", 1, "corners_px", 2, to=[1, None]),
            "scenes[1].frames[3].markers[1].corners_px: must be 4 rows of 2 finite numbers",
        ),
    ],
)
def test_what_breaks_the_format_is_told_by_its_key(
    tmp_path: Path, change: Callable[[dict[str, Any]], None], words: str
) -> None:
    content = recorded()
    change(content)
    with pytest.raises(FileInputError) as refused:
        read_detections(written(tmp_path, content))
    assert words in f"{refused.value.data['key']}: {refused.value.data['rule']}\n{refused.value}"
