"""A cell to work in: the simulated one, or the real one behind a port. The same code runs on both."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from arm.errors import InputError
from cell.taskfile import Task
from driver.clock import Clock
from driver.mars import Mars
from driver.wirelog import WireLog
from vision.frames import FrameSource, Image, ImageFolder

if TYPE_CHECKING:
    from cell.simulation import SimulatedCell
    from driver.emulator import Emulator


AWAIT_S = 120.0  # for new photographs


@dataclass(frozen=True)
class Connection:
    """An open cell.

    Attributes:
        mars: the controller, not yet identified.
        frames: the camera.
        time_scale: controller seconds per wall second.
        simulated: truth of the simulated cell, for the report only; None on the real one.
        emulator: of the simulated cell; None on the real one.
    """

    mars: Mars
    frames: FrameSource
    time_scale: float
    simulated: SimulatedCell | None = None
    emulator: Emulator | None = None


class AwaitedPhotographs:
    """A folder into which somebody puts new photographs for each look, because every look needs the cell of now.

    Args:
        path: the folder; photographs that are there already are old and never looked at.

    Raises:
        InputError: it is not there.
    """

    def __init__(self, path: Path) -> None:
        self._folder = ImageFolder(path, only_new=True)

    def grab(self, count: int) -> list[Image]:
        """The next `count` photographs, waited for.

        Raises:
            InputError: they did not come in time, or cannot be read.
        """
        if self._folder.fresh() < count:
            print(
                f"put {count} new photographs into {self._folder.path} within {AWAIT_S:g} s", file=sys.stderr
            )
        over = time.monotonic() + AWAIT_S
        while self._folder.fresh() < count and time.monotonic() < over:
            time.sleep(0.2)
        return self._folder.grab(count)


def world_file(task: Task, world: Path | None) -> Path:
    """The world file given, or the one beside the task file.

    Raises:
        InputError: there is none.
    """
    path = world or task.file.with_suffix(".world.toml")
    if not path.is_file():
        raise InputError(
            f"{path}: there is no such world file; the simulated cell needs one (--world), the real one --port",
            file=str(path),
        )
    return path


@contextmanager
def open_cell(
    task: Task,
    port: str | None,
    world: Path | None,
    images: Path | None,
    time_scale: float,
    log: Path,
) -> Iterator[Connection]:
    """The real cell if a port is given, else the simulated one.

    Raises:
        InputError: port, world file or camera are not there.
    """
    if not 0.01 <= time_scale <= 100.0:
        raise InputError(f"time scale = {time_scale:g}: must be from 0.01 to 100", time_scale=time_scale)
    if port is None and images is not None:
        raise InputError("--images needs --port: the simulated cell has its own camera", images=str(images))
    real = port is not None
    opened = (
        _open_real(task, port or "", images, log) if real else _open_simulated(task, world, time_scale, log)
    )
    with opened as connection:
        yield connection


@contextmanager
def _open_real(task: Task, port: str, images: Path | None, log: Path) -> Iterator[Connection]:
    if images is None:
        raise InputError("a camera is needed with --port: give photographs with --images", port=port)
    clock = Clock()
    with WireLog(log, clock) as wire, Mars(port, task.cell.unit, clock, wire) as mars:
        yield Connection(mars, AwaitedPhotographs(images), 1.0)


@contextmanager
def _open_simulated(task: Task, world: Path | None, time_scale: float, log: Path) -> Iterator[Connection]:
    from cell.simulation import SimulatedCamera, SimulatedCell
    from cell.worldfile import read_world
    from driver.emulator import Emulator

    cell = task.cell
    truth = read_world(world_file(task, world), cell.boards[0].marker_size)
    simulated = SimulatedCell(cell, truth)
    clock = Clock(time_scale)
    with Emulator(cell.unit, clock, plant=simulated) as emulator:
        simulated.now_ms = emulator.now_ms
        frames = SimulatedCamera(simulated, truth.camera or cell.camera, emulator.counts, cell.dictionary)
        with WireLog(log, clock) as wire, Mars(emulator.open_pty(), cell.unit, clock, wire) as mars:
            yield Connection(mars, frames, time_scale, simulated, emulator)
