"""A simulated camera that writes its images to a folder, for programs that work with an emulated unit."""

from __future__ import annotations

import contextlib
import re
import time
from pathlib import Path

import cv2

from arm.errors import ExecutionStopped, InputError
from arm.io.storage import unmade
from arm.io.temporary import TemporaryFile, mode_of_new
from cell.sim.camera import SimulatedCamera
from cell.sim.cell import SimulatedCell
from driver.emulator import Emulator

STILL_S = 1.0  # wall time at rest before a set is written, so that it is new for a look after a motion
EVERY_S = 5.0  # wall time from one set to the next, while nothing moves
KEEP_SETS = 3  # number of sets that stay in the folder
_NAME = re.compile(r"emulated-(\d+)\.png")


class FolderCamera:
    """Write sets of images, only while the arm is at rest; `poll` must be called continually.

    A set shows one moment. It is written as a whole, under increasing names, and only if nothing has moved since that
    moment. So images that appear after the request of a look show the present cell.

    Args:
        simulated: the cell.
        camera: that sees it.
        emulator: whose plant is `simulated`.
        folder: created if missing. Older sets of such a camera in it are deleted.

    Raises:
        InputError: the folder cannot be created.
    """

    def __init__(
        self, simulated: SimulatedCell, camera: SimulatedCamera, emulator: Emulator, folder: Path
    ) -> None:
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise InputError(
                f"{folder}: cannot be created: {unmade(folder, error)}", folder=str(folder)
            ) from error
        self.folder = folder
        self._simulated = simulated
        self._camera = camera
        self._emulator = emulator
        self._count = simulated.cell.photographs
        own = self._own()
        self._number = max((number for number, _ in own), default=0)
        for _, file in own:  # they show another cell, and a look takes the first images of a folder
            _remove(file)
        self._seen: tuple[object, ...] = ()
        self._due = 0.0

    def poll(self) -> bool:
        """Write a set if one is due; return whether one was written.

        Raises:
            ExecutionStopped: the folder can no longer be written.
        """
        now = time.monotonic()
        if self._moved():
            self._seen, self._due = self._state(), now + STILL_S
        if now < self._due:
            return False
        try:
            return self._take()
        except OSError as error:
            why = f"{self.folder}: images cannot be written: {error.strerror}"
            raise ExecutionStopped(why, folder=str(self.folder)) from error

    def _moved(self) -> bool:
        """Whether anything moves, or moved since the last set or motion."""
        return self._emulator.machine.busy or self._state() != self._seen

    def _state(self) -> tuple[object, ...]:
        """Changes with every motion of arm or jaws."""
        return self._emulator.counts(), len(self._simulated.history)

    def _take(self) -> bool:
        images = [cv2.imencode(".png", image)[1].tobytes() for image in self._camera.grab(self._count)]
        files = [self.folder / f"emulated-{self._number + n:06d}.png" for n in range(1, len(images) + 1)]
        with contextlib.ExitStack() as opened:  # a temporary file has no suffix of an image
            parts = [opened.enter_context(TemporaryFile(file)) for file in files]
            for part, image in zip(parts, images, strict=True):
                part.write([image])
            if self._moved():
                self._due = time.monotonic() + STILL_S
                return False  # it shows an outdated cell
            for part in parts:
                part.become(mode_of_new())
        self._number += len(files)
        self._due = time.monotonic() + EVERY_S
        for number, file in self._own():
            if number <= self._number - KEEP_SETS * self._count:
                _remove(file)
        return True

    def _own(self) -> list[tuple[int, Path]]:
        """Images of this camera, or of an earlier one, with their numbers."""
        found = ((_NAME.fullmatch(file.name), file) for file in self.folder.iterdir())
        return [(int(match[1]), file) for match, file in found if match]


def _remove(file: Path) -> None:
    with contextlib.suppress(FileNotFoundError):  # already removed
        file.unlink()
