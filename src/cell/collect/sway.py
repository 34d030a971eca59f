"""The camera's sway while a target is shown: images as the camera would have taken them before the first pose.

A camera on a post sways and drifts by more than the corners' noise. Without this correction, the hand-eye calibration
takes the camera's motion for scatter of the arm, or refuses a camera that moved.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from arm.errors import ImpossibleError, InputError
from cell.config.cell import Cell
from cell.console import Console
from cell.session.camera_watch import take_background, watch_with
from vision.background.camera_shift import UNRECOGNISED
from vision.background.features import read_background, write_background
from vision.background.watch import CameraWatch
from vision.camera.frame_source import FrameSource
from vision.camera.model import Image


class Sway:
    """Compare images with the background before the first pose.

    The background is kept beside the recording, so that a continued recording is of the same camera pose.

    Args:
        file: of the background; used if it exists.
        cell: cell of the camera. Its extrinsics may be rough: a shift is a rotation of the camera.
        console: output.

    Raises:
        InputError: the file is no background of this camera.
    """

    def __init__(self, file: Path, cell: Cell, console: Console) -> None:
        self.file, self.cell, self.console = file, cell, console
        self.unseen = 0  # looks in which too little of the background was seen
        self.largest = 0.0  # m at the table
        # of the recording: a calibration meanwhile changes neither
        self._camera = cell.nominal_camera.at(np.eye(4))
        self._watch: CameraWatch | None = None
        if file.exists():
            self._watch = watch_with(read_background(file, self._camera), cell)

    @property
    def is_measured(self) -> bool:
        """Whether images are compared with a background."""
        return self._watch is not None

    def begin(self, frames: FrameSource) -> None:
        """Take the background, with the arm out of view; without enough of it, images stay as they are."""
        images = frames.grab(self.cell.photographs)
        try:
            background, _ = take_background(self.cell, images)
        except (ImpossibleError, InputError) as error:
            self.console.step(f"the camera's sway is not measured, so it adds to the arm's scatter: {error}")
            return
        background = replace(background, camera=self._camera.digest)
        write_background(self.file, background)
        self._watch = watch_with(background, self.cell)
        self.console.step(
            f"{len(background.points)} features of the background in {self.file}: the camera's sway is measured "
            "in every image and taken out"
        )

    def steadied(self, images: Sequence[Image]) -> Sequence[Image]:
        """Return images as the camera would have taken them before the first pose.

        They stay as they are where the arm hides too much of the background.

        Raises:
            ImpossibleError: the camera has moved by more than `camera_moved_mm`, or in another way than by a rotation.
        """
        if self._watch is None:
            return images
        try:
            steady, shift = self._watch.steady(images, self._camera)
        except ImpossibleError as error:
            if error.data.get("reason") != UNRECOGNISED:
                raise
            self.unseen += 1
            return images
        self.largest = max(self.largest, shift.move)
        return steady

    def report(self) -> None:
        """Say how far the camera swayed."""
        if self._watch is None:
            return
        looks = "1 look" if self.unseen == 1 else f"{self.unseen} looks"
        hidden = f"; in {looks} the arm hid the background" if self.unseen else ""
        self.console.step(f"the camera swayed by up to {1e3 * self.largest:.2f} mm at the table{hidden}")
