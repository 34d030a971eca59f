"""A cell to work in: the simulated one, or the real one behind a port. The same code runs on both."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from arm.errors import InputError
from cell.config.camera_keys import OF_CELL
from cell.console import say_on_stderr
from cell.files.task import Task
from cell.session.cameras import open_basler, require_one_camera
from driver.line.clock import Clock
from driver.line.stepped_clock import SteppedClock
from driver.line.wire_log import WireLog
from driver.mars.mars import Mars
from vision.camera.basler_devices import read_selector
from vision.camera.frame_source import IMAGE_SUFFIXES, FrameSource, Image, ImageFolder

if TYPE_CHECKING:
    from cell.config.cell import Cell
    from cell.sim.cell import SimulatedCamera, SimulatedCell
    from driver.emulator import Emulator


TIME_SCALE = 10.0  # of the simulated cell
AWAIT_S = 120.0  # for new photographs
COPIED_S = 0.5  # without growing, for a photograph to be whole
POLL_S = 0.1


@dataclass(frozen=True)
class WhichCell:
    """The real cell behind a port, or the simulated one.

    Attributes:
        port: of the real controller; None: the simulated cell.
        world: truth of the simulated cell.
        images, camera: where the real one's photographs come from; None: the cell file's camera.
        speed: share of what the registers allow (`cell.session.speed`); None: the cell file's, of a plan file its own.
        time_scale: most controller seconds per wall second of the simulated cell; None: `TIME_SCALE`.
        homed: the unit was homed before and kept its positions; it is not homed anew.
        preload: each motion is loaded and verified before it begins (`driver.execution.preload`).
    """

    port: str | None = None
    world: Path | None = None
    images: Path | None = None
    camera: str | None = None
    speed: float | None = None
    time_scale: float | None = None
    homed: bool = False
    preload: bool = False


@dataclass(frozen=True)
class Connection:
    """An open cell.

    Attributes:
        mars: the controller, not yet identified.
        frames: the camera.
        time_scale: most controller seconds per wall second.
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

    What lies there when a look asks is old, whoever put it there and however late: it may show the cell of before
    the last motion.

    Args:
        path: the folder.

    Raises:
        InputError: it is not there.
    """

    def __init__(self, path: Path) -> None:
        self.path = ImageFolder(path).path

    def grab(self, count: int) -> list[Image]:
        """`count` photographs that came after this was called; waited for, `AWAIT_S` at most.

        A photograph that is still being copied is waited for too: the half of one can look like a whole one.

        Raises:
            InputError: they did not come in time, or cannot be read.
        """
        folder, old = ImageFolder(self.path, only_new=True), _sizes(self.path)
        say_on_stderr(f"{self.path}: waiting for {_wanted(count, len(old))}, for up to {AWAIT_S:g} s")
        over = time.monotonic() + AWAIT_S
        seen: list[tuple[str, int]] = []
        same_since = time.monotonic()
        while (now := time.monotonic()) < over:
            new = sorted((name, size) for name, size in _sizes(self.path).items() if name not in old)[:count]
            if new != seen:
                seen, same_since = new, now
            if len(new) == count and now - same_since >= COPIED_S:
                break
            time.sleep(POLL_S)
        return folder.grab(count)


def _sizes(path: Path) -> dict[str, int]:
    """Bytes of the photographs in a folder, by name."""
    sizes = {}
    for file in path.iterdir():
        if file.suffix.lower() in IMAGE_SUFFIXES:
            with contextlib.suppress(FileNotFoundError):  # removed since it was listed
                sizes[file.name] = file.stat().st_size
    return sizes


def _wanted(count: int, there: int) -> str:
    """No order: in a rehearsal it is the emulator that puts them there."""
    new = f"{count} new photograph{'' if count == 1 else 's'}"
    if not there:
        return new
    lie = "1 that lies there already does" if there == 1 else f"{there} that lie there already do"
    return f"{new} under other names ({lie} not count)"


def world_file(task: Task, world: Path | None) -> Path:
    """The world file given, or the one beside the task file.

    Raises:
        InputError: there is none.
    """
    path = world or task.file.with_suffix(".world.toml")
    if not path.exists():  # whatever else it is, its reader says
        raise InputError(
            f"{path}: there is no such world file; the simulated cell needs one (--world), the real one --port",
            file=str(path),
        )
    return path


def require_openable(task: Task, where: WhichCell) -> None:
    """See that options go together and that what they name is there; nothing is opened.

    Raises:
        InputError: an option is wrong, or world file, folder or the name of a camera are not there.
    """
    port, images, camera, time_scale = where.port, where.images, where.camera, where.time_scale
    if time_scale is not None and not 0.01 <= time_scale <= 100.0:
        raise InputError(f"time scale = {time_scale:g}: must be from 0.01 to 100", time_scale=time_scale)
    if time_scale is not None and port is not None:
        raise InputError(
            f"--time-scale {time_scale:g} is of the simulated cell; the unit on {port} has its own time",
            time_scale=time_scale,
        )
    require_one_camera(images, camera)
    for option, given in (("--images", images), ("--camera", camera)):
        if port is None and given is not None:
            raise InputError(f"{option} needs --port: the simulated cell has its own camera", option=option)
    if port is None:
        world_file(task, where.world)
    elif images is not None:
        AwaitedPhotographs(images)
    elif camera in (None, OF_CELL) and task.cell.basler.device is None:
        raise InputError(
            "a camera is needed with --port: name one with --camera or in the cell file ([look.basler] device), or "
            "give photographs with --images",
            port=port,
        )
    elif camera is not None and camera != OF_CELL:
        read_selector(camera)


@contextmanager
def open_cell(task: Task, where: WhichCell, log: Path) -> Iterator[Connection]:
    """The real cell if it has a port, else the simulated one; what is sent and received goes into a log.

    Raises:
        InputError: port, world file or camera are not there.
    """
    require_openable(task, where)
    opened = (
        _open_real(task, where.port, where.images, where.camera, log)
        if where.port is not None
        else _open_simulated(task, where.world, where.time_scale or TIME_SCALE, log)
    )
    with opened as connection:
        yield connection


@contextmanager
def _open_real(
    task: Task, port: str, images: Path | None, camera: str | None, log: Path
) -> Iterator[Connection]:
    clock = Clock()
    # the camera is there before anything is sent, and is let go after the arm was told to stop
    with (
        _real_camera(task.cell, images, camera) as frames,
        WireLog(log, clock) as wire,
        Mars(port, task.cell.unit, clock, wire) as mars,
    ):
        yield Connection(mars, frames, 1.0)


@contextmanager
def _real_camera(cell: Cell, images: Path | None, camera: str | None) -> Iterator[FrameSource]:
    if images is not None:
        yield AwaitedPhotographs(images)
        return
    with open_basler(cell, camera) as frames:
        yield frames


def simulated_cell(task: Task, world: Path | None) -> SimulatedCell:
    """The cell of a task as the world file has it, to be a unit's plant.

    Raises:
        InputError: there is no world file, or it is wrong.
    """
    from cell.files.world import read_world
    from cell.sim.cell import SimulatedCell

    cell = task.cell
    return SimulatedCell(cell, read_world(world_file(task, world), cell.boards[0].marker_size))


def join(simulated: SimulatedCell, emulator: Emulator) -> SimulatedCamera:
    """Give a simulated cell the time of the unit whose plant it is; the camera that sees the unit's arm in it."""
    from cell.sim.cell import SimulatedCamera

    simulated.now_ms = emulator.now_ms
    camera = simulated.world.camera or simulated.cell.nominal_camera
    return SimulatedCamera(simulated, camera, emulator.counts, simulated.cell.dictionary)


@contextmanager
def _open_simulated(task: Task, world: Path | None, time_scale: float, log: Path) -> Iterator[Connection]:
    from driver.emulator import Emulator

    unit, simulated = task.cell.unit, simulated_cell(task, world)
    clock = SteppedClock(time_scale)  # no host is too busy for it
    with Emulator(task.cell.nominal_unit, clock, plant=simulated) as emulator:
        frames = join(simulated, emulator)
        with WireLog(log, clock) as wire, Mars(emulator.open_line(), unit, clock, wire) as mars:
            yield Connection(mars, frames, time_scale, simulated, emulator)
