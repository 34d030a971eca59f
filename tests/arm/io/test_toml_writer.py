"""What is written as TOML comes back."""

from __future__ import annotations

import datetime
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np

from arm.calibration_file import ArmCalibration, read_arm_calibration, write_arm_calibration
from arm.io.toml_writer import toml_lines
from arm.robot.link_errors import LinkErrors
from arm.se3 import frozen, rotation, transform

LINKS = 1e-4 * np.random.default_rng(0).normal(size=(3, 6))

OFFSETS = frozen(np.radians([0.0, 0.31, -0.27, 0.003, -0.4, 0.0]))

ERRORS = LinkErrors(frozen(LINKS[0]), frozen(LINKS[1]), frozen(LINKS[2]))

FOUND = ArmCalibration(
    transform(rotation([0.1, -3.0, 0.2]), (0.49, -0.0147, 1.19)),
    OFFSETS,
    ERRORS,
    "crs93",
    "abc",
    "def",
    {"poses": 24, "ok": True},
)


def test_information_with_any_characters_is_read_back(tmp_path: Path) -> None:
    told = {
        "target": 'a "plate" of 5\\8 inch,\n\tbent\x7f',
        "where": "Žižkov 🦾",
        "flags": [True, False],
        "texts": ["it's", "[made]"],
        "nested": [[1, 2], [-3.5e-300]],
        "of_a_tuple": (1e22, "x"),
        "when": datetime.date(2026, 11, 22),
    }
    path = tmp_path / "c.toml"
    write_arm_calibration(path, replace(FOUND, made={key: told[key] for key in told if key != "when"}))
    back = dict(read_arm_calibration(path).made)
    assert back == {**{key: told[key] for key in told if key != "when"}, "of_a_tuple": [1e22, "x"]}
    assert tomllib.loads("\n".join(toml_lines({"when": told["when"]}))) == {"when": told["when"]}
