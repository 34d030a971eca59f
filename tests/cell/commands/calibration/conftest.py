"""What tests of the verbs around calibration share."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from calib.hand_eye.calibrate import HandEye
from calib.recordings.arm import recording_json


@pytest.fixture
def data(found: HandEye, tmp_path: Path) -> Path:
    path = tmp_path / "arm.json"
    path.write_text(json.dumps(recording_json(found.recording)))
    return path
