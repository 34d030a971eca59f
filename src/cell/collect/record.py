"""A recording of a held target, extended pose by pose; an interrupted one can be continued."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from arm.errors import InputError
from arm.io.storage import read_bytes, sha256
from arm.robot.dh import A465
from arm.se3 import Array, frozen
from calib.recordings.arm import ArmRecording, read_arm_recording, write_arm_recording
from cell.config.cell import Cell
from cell.files.hand_target import HandTarget

CHANGED = "changed meanwhile"
"""Reason of an error: another program changed the file."""


class HandRecord:
    """A recording in progress, in a file that is complete after every pose.

    Args:
        file: recording to continue, or a new file.
        cell: cell of the arm and the camera.
        hand: held target.

    Raises:
        InputError: the file is not a recording, or belongs to another target, camera or arm.
    """

    def __init__(self, file: Path, cell: Cell, hand: HandTarget) -> None:
        self.file, self.cell, self.hand = file, cell, hand
        self.joints: list[Array] = []
        self.pixels: list[Array] = []
        self._known = self._on_disk()
        if file.exists():
            self._go_on(read_arm_recording(file))

    def _go_on(self, before: ArmRecording) -> None:
        points = self.hand.target.points()
        other = {
            "target": before.points.shape != points.shape
            or not np.allclose(before.points, points, atol=1e-9),
            "camera": before.camera.lens_digest != self.cell.nominal_camera.lens_digest,
            "arm": before.dh.digest != A465.digest or before.unit != self.cell.unit.name,
        }
        differing = [name for name, is_other in other.items() if is_other]
        if differing:
            why = f"{self.file}: holds poses of another {' and '.join(differing)}; give a new file"
            raise InputError(why, file=str(self.file), differing=differing)
        self.joints, self.pixels = list(before.joints), list(before.pixels)

    def __len__(self) -> int:
        return len(self.joints)

    def add(self, counts: tuple[int, ...], pixels: Array) -> None:
        """Append a pose and write the file.

        Args:
            counts: encoder counts at rest.
            pixels: corners (m, 2), px; NaN for corners that were not detected.

        Raises:
            InputError: the file cannot be written, or another program changed it; it is left as it is.
        """
        now = self._on_disk()
        if now not in (self._known, None):
            raise InputError(
                f"{self.file}: was changed by another program since this command last read or wrote it, so it is not "
                "overwritten, and the pose just taken is lost; end that program, then repeat this command to continue "
                "from the present file",
                file=str(self.file),
                reason=CHANGED,
            )
        self.joints.append(frozen(self.cell.nominal_unit.positions(counts)))
        self.pixels.append(pixels)
        write_arm_recording(self.file, self.recording())
        self._known = self._on_disk()

    def _on_disk(self) -> str | None:
        """Return the hash of the file; None if there is none."""
        return sha256(read_bytes(self.file, "JSON")) if self.file.exists() else None

    def configurations(self) -> Array:
        """Return the configurations of the poses (n, 6), rad, by the zeros of the cell's (calibrated) unit."""
        return np.array([self.from_readings(q) for q in self.joints]).reshape(-1, 6)

    def from_readings(self, q: Array) -> Array:
        """Convert a configuration (6,), rad, from nominal zeros to those of the cell's unit."""
        return self.cell.unit.positions(self.cell.nominal_unit.counts(q))

    def to_readings(self, q: Array) -> Array:
        """Convert a configuration (6,), rad, from the zeros of the cell's unit to nominal ones."""
        return self.cell.nominal_unit.positions(self.cell.unit.counts(q))

    def recording(self) -> ArmRecording:
        """Return the whole recording; its joint angles are by nominal zeros."""
        return ArmRecording(
            self.cell.nominal_camera.at(np.eye(4)),
            A465,
            self.hand.target.points(),
            self.hand.target.kind,
            frozen(np.array(self.joints)),
            frozen(np.array(self.pixels)),
            self.cell.unit.name,
            self.hand.size_within,
        )
