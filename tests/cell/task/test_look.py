"""A look that is refused still leaves what a person needs: the photograph with its markers, and what is wrong."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from arm.errors import ImpossibleError
from arm.io.storage import data_file
from cell.commands.render import render_step
from cell.commands.steps import look_step
from cell.console import Console


@pytest.mark.slow
def test_a_refused_look_writes_its_picture_and_warns_of_the_light(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shots = tmp_path / "shots"
    render_step(data_file("scenes/task2.toml"), None, shots, 5, Console(as_json=True))
    for file in sorted(shots.iterdir()):
        image = cv2.imread(str(file), cv2.IMREAD_GRAYSCALE)
        assert image is not None
        image[:, :960] = 255  # one of the boards
        cv2.imwrite(str(file), np.clip(image.astype(float) * 2.0, 0, 255).astype(np.uint8))
    picture = tmp_path / "look.png"
    picture.write_bytes(b"an older one")
    with pytest.raises(ImpossibleError):
        look_step(data_file("scenes/task2.toml"), shots, None, None, picture, Console())
    drawn = cv2.imread(str(picture))
    assert drawn is not None
    assert drawn.shape == (1200, 1920, 3)
    assert (drawn.max(axis=2) != drawn.min(axis=2)).any()  # markers in colour
    assert "WARNING: the images are too bright" in capsys.readouterr().out
