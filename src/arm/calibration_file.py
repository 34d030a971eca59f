"""Calibration files of an arm and its camera, which a cell file names.

``a465 calibrate hand-eye`` writes them. Reading the cell applies them: extrinsics and refined intrinsics to the camera,
joint offsets (zeros) to the encoders of the unit. The files of the unit and of the camera stay unchanged.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

import numpy as np

from arm.io.keys import Keys, key
from arm.io.node import Node, Rule
from arm.io.rules import covariance_matrix, numbers, rigid, table, text
from arm.io.storage import sha256, write_atomic
from arm.io.toml_writer import toml_lines, toml_rows
from arm.robot.link_errors import LinkErrors
from arm.se3 import Array

LARGEST_LINK = (0.02, np.radians(2.0))  # m and rad, largest link errors
COVARIANCE = (6, 6, 6, 6, 6, 9)
"""Numbers of the camera's twist, of the joint offsets, of the errors of d, a and alpha, and of the intrinsics."""
LARGEST_ZERO = np.radians(5.0)  # rad, largest joint offset; a larger one means wrong homing


@dataclass(frozen=True, eq=False)
class ArmCalibration:
    """Result of a calibration.

    Attributes:
        T_base_camera: pose of the camera, 4x4.
        joint_offsets: true joint positions minus those of the encoders, (6,) rad.
        links: errors of the arm's links.
        unit: name of the calibrated unit; "" if not known.
        lens: digest of the camera's intrinsics that the result depends on; "" if not known.
        dh: digest of the arm's nominal Denavit-Hartenberg parameters; "" if not known.
        made: quality, date and sources, for information only: strings, numbers, booleans, or lists of these.
        intrinsics: fx fy cx cy k1 k2 p1 p2 k3 as the images refine them, (9,); None: those of the camera file.
        scatter: standard deviation of each joint about its calibrated position, (6,) rad; None if not known.
        covariance: of the errors of `T_base_camera` (twist in its own frame, translation first), `joint_offsets`, d, a
            and alpha of `links`, and the intrinsics, `COVARIANCE` of each, SI and px; None if not known.
    """

    T_base_camera: Array
    joint_offsets: Array
    links: LinkErrors = field(default_factory=LinkErrors.none)
    unit: str = ""
    lens: str = ""
    dh: str = ""
    made: Mapping[str, Any] = field(default_factory=dict)
    intrinsics: Array | None = None
    scatter: Array | None = None
    covariance: Array | None = None

    @property
    def id(self) -> str:
        """Hash of all values: the same values have the same id, and manual edits are detected."""
        of: dict[str, Any] = {"unit": self.unit, "lens": self.lens, "dh": self.dh, "made": dict(self.made)}
        numbers = {"camera": self.T_base_camera, "offsets": self.joint_offsets, "intrinsics": self.intrinsics}
        numbers |= {"joint_scatter_rad": self.scatter, "covariance": self.covariance}
        of |= {name: values.tolist() for name, values in numbers.items() if values is not None}
        return "hand-eye-" + sha256({**of, "links": self.links.to_json()})[:12]


def _made(node: Node) -> dict[str, Any]:
    """Return the information on the calibration; only types that can be written back, because the id covers it."""
    values = table().read(node)
    for name, value in values.items():
        if not _writable(value):
            raise node[name].error("must be a string, a finite number, true or false, or a list of these")
    return values


def _writable(value: object) -> bool:
    if isinstance(value, list):
        return all(map(_writable, value))
    return isinstance(value, str | int) or (isinstance(value, float) and math.isfinite(value))


def _links(unit: str, largest: float) -> Rule[Array]:
    return numbers(6, unit, -largest, largest)


def _intrinsics(node: Node) -> Array:
    values = numbers(9).read(node)
    if values[:2].min() <= 0.0:
        raise node.error("must be [fx, fy, cx, cy, k1, k2, p1, p2, k3] with fx, fy above 0")
    return values


class CalibrationKeys(Keys):
    """Keys of a calibration file."""

    id: str = key("id", text())
    T_base_camera: Array = key("T_base_camera", rigid())
    joint_offsets: Array = key("joint_offsets_rad", _links("rad", LARGEST_ZERO))
    d: Array = key("dh_d_error_m", _links("m", LARGEST_LINK[0]), [0] * 6)
    a: Array = key("dh_a_error_m", _links("m", LARGEST_LINK[0]), [0] * 6)
    alpha: Array = key("dh_alpha_error_rad", _links("rad", LARGEST_LINK[1]), [0] * 6)
    unit: str = key("unit", text(), "")
    lens: str = key("lens", text(), "")
    dh: str = key("dh", text(), "")
    intrinsics: Array | None = key("intrinsics", Rule(numbers(9).words, _intrinsics), None)
    scatter: Array | None = key("joint_scatter_rad", numbers(6, "rad", 0.0, LARGEST_ZERO), None)
    covariance: Array | None = key("covariance", covariance_matrix(sum(COVARIANCE)), None)
    made: Mapping[str, Any] = key("made", Rule("a table", _made), {})


def read_arm_calibration(path: Path) -> ArmCalibration:
    """Read a calibration file.

    Raises:
        FileInputError: a value breaks its rule, or the id is not the hash of the values (they were edited by hand).
    """
    root = Node.of_toml(path, "calibration")
    keys = CalibrationKeys.read(root)
    values = {**vars(keys), "links": LinkErrors(keys.d, keys.a, keys.alpha)}
    calibration = ArmCalibration(**{f.name: values[f.name] for f in fields(ArmCalibration)})
    if keys.id != calibration.id:
        rule = f"must be {calibration.id}, the hash of the values; they were changed after the calibration"
        raise root.error_at("id", rule)
    return calibration


def write_arm_calibration(path: Path, calibration: ArmCalibration) -> None:
    """Write a file that `read_arm_calibration` reads back to the last bit.

    Raises:
        InputError: the file cannot be written.
    """
    names = {"unit": calibration.unit, "lens": calibration.lens, "dh": calibration.dh}
    lines = [
        '# Made by a465 calibrate hand-eye; a cell file names it with its key "calibration".',
        *toml_lines({"id": calibration.id} | {key: value for key, value in names.items() if value}),
        f"T_base_camera = {toml_rows(calibration.T_base_camera)}",
        f"joint_offsets_rad = {calibration.joint_offsets.tolist()}",
    ]
    d, a, alpha = calibration.links.to_json()
    if any((*d, *a, *alpha)):
        lines += [f"dh_d_error_m = {d}", f"dh_a_error_m = {a}", f"dh_alpha_error_rad = {alpha}"]
    if calibration.intrinsics is not None:
        lines += ["# fx fy cx cy k1 k2 p1 p2 k3", f"intrinsics = {calibration.intrinsics.tolist()}"]
    if calibration.scatter is not None:
        lines.append(f"joint_scatter_rad = {calibration.scatter.tolist()}")
    if calibration.covariance is not None:
        lines += [
            "# of the camera's twist, joint offsets, d, a, alpha, intrinsics",
            f"covariance = {toml_rows(calibration.covariance)}",
        ]
    if calibration.made:
        lines += ["", "[made]", *toml_lines(calibration.made)]
    write_atomic(path, "\n".join(lines) + "\n")
