"""Open a cell: the simulated one, or the real one behind a port. The same code runs on both."""

from __future__ import annotations

import contextlib
import os
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from arm.errors import FileInputError, InputError
from arm.numerics.products import mul
from arm.robot.shapes import Body
from arm.se3 import rotation, transform
from cell.config.camera_keys import OF_CELL
from cell.console import say_on_stderr
from cell.files.task import Task, tasks_in
from cell.program.program_file import ProgramTask
from cell.session.cameras import device_of, open_camera, require_live, require_one_camera
from driver.line.clock import Clock
from driver.line.stepped_clock import SteppedClock
from driver.line.wire_log import WireLog
from driver.mars.mars import Mars
from vision.camera.frame_source import IMAGE_SUFFIXES, FrameSource, Image, ImageFolder

if TYPE_CHECKING:
    from cell.files.world import World
    from cell.sim.camera import SimulatedCamera
    from cell.sim.cell import SimulatedCell
    from cell.sim.target_photos import TargetCamera
    from cell.sim.touches import TrueWire
    from driver.emulator import Emulator


TIME_SCALE = 10.0  # of the simulated cell
AWAIT_S = 120.0  # timeout for new images
COPIED_S = 0.5  # an image file whose size has been constant for this time is complete
POLL_S = 0.1  # between two looks into the folder


@dataclass(frozen=True)
class WhichCell:
    """The real cell behind a port, or the simulated one.

    Attributes:
        port: of the real controller; None: the simulated cell.
        world: world file of the simulated cell.
        images, camera: source of the real cell's images; None: the cell file's camera.
        speed: fraction of what the registers allow (`cell.session.speed`); None: the cell file's, or the plan file's.
        time_scale: maximum controller seconds per wall second of the simulated cell; None: `TIME_SCALE`.
        homed: whether the unit was homed before and kept its positions; it is not homed again.
        preload: whether each motion is loaded and verified before it begins (`driver.mars.streaming.preload`).
        contact: whether the simulated cell has contact physics (`cell.contact`).
        blind: whether the real cell is opened without a camera.
    """

    port: str | None = None
    world: Path | None = None
    images: Path | None = None
    camera: str | None = None
    speed: float | None = None
    time_scale: float | None = None
    homed: bool = False
    preload: bool = False
    contact: bool = False
    blind: bool = False


@dataclass(frozen=True)
class Connection:
    """An open cell.

    Attributes:
        mars: the controller, not yet identified.
        frames: the camera.
        time_scale: maximum controller seconds per wall second.
        simulated: ground truth of the simulated cell, for the report only; None on the real one.
        emulator: of the simulated cell; None on the real one.
    """

    mars: Mars
    frames: FrameSource
    time_scale: float
    simulated: SimulatedCell | None = None
    emulator: Emulator | None = None


class NoImages:
    """The frames of a cell that was opened without a camera."""

    def grab(self, count: int) -> list[Image]:
        """Raises InputError: there are none."""
        raise InputError(f"{count} images: this command opens no camera", images=count)


class NewImageFolder:
    """A folder that receives new images for each look.

    Images that are there when a look begins are ignored, because they may show the cell before the last motion.

    Args:
        path: the folder.

    Raises:
        InputError: it does not exist.
    """

    def __init__(self, path: Path) -> None:
        self.path = ImageFolder(path).path

    def grab(self, count: int) -> list[Image]:
        """Wait up to `AWAIT_S` for `count` images that arrive after this call.

        Images must first stop growing, because an incomplete copy can be read as an image.

        Raises:
            InputError: they did not arrive in time, or cannot be read.
        """
        folder, old = ImageFolder(self.path, only_new=True), _sizes(self.path)
        say_on_stderr(f"{self.path}: waiting for {_wanted(count, len(old))}, for up to {AWAIT_S:g} s")
        over = time.monotonic() + AWAIT_S
        last: list[tuple[str, int]] = []
        same_since = time.monotonic()
        while (now := time.monotonic()) < over:
            new = sorted((name, size) for name, size in _sizes(self.path).items() if name not in old)[:count]
            if new != last:
                last, same_since = new, now
            if len(new) == count and now - same_since >= COPIED_S:
                break
            time.sleep(POLL_S)
        return folder.grab(count)


def _sizes(path: Path) -> dict[str, int]:
    """Sizes in bytes of the images in a folder, by name."""
    sizes = {}
    for file in path.iterdir():
        if file.suffix.lower() in IMAGE_SUFFIXES:
            with contextlib.suppress(FileNotFoundError):  # removed since it was listed
                sizes[file.name] = file.stat().st_size
    return sizes


def _wanted(count: int, there: int) -> str:
    """What `grab` waits for, in words."""
    new = f"{count} new image{'' if count == 1 else 's'}"
    if not there:
        return new
    ignored = "the 1 already there does" if there == 1 else f"the {there} already there do"
    return f"{new} under other names ({ignored} not count)"


def world_file(task: Task, world: Path | None) -> Path:
    """The given world file, or the one beside the task file or else beside its cell file.

    Raises:
        InputError: there is none.
    """
    beside = task.file.with_suffix(".world.toml")
    shared = task.cell.file.with_suffix(".world.toml")
    path = world or (beside if beside.exists() or not shared.exists() else shared)
    if not path.exists():  # its reader reports anything else
        why = f"{path}: no such world file"
        real = "for the real cell --port, --images or --camera, where the command has them"
        if world is None:
            why += f"; give --world, or {real}"
        if world is None and task.file == task.cell.file:
            tasks = tasks_in(task.file.parent)
            give = f"give a task file ({', '.join(tasks)})" if tasks else "give a task file"
            why = f"{task.file}: is a cell file, and worlds stand beside task files; {give}, or --world, or {real}"
        raise InputError(why, file=str(path))
    return path


def require_openable(task: Task, where: WhichCell) -> None:
    """Check that options are consistent and that what they name exists, without opening anything.

    Raises:
        InputError: an option is wrong, or world file, folder, camera name or the library of `contact` is missing.
    """
    live = task.cell.live_camera
    port, images, camera, time_scale = where.port, where.images, where.camera, where.time_scale
    if time_scale is not None and not 0.01 <= time_scale <= 100.0:
        raise InputError(f"--time-scale {time_scale:g}: must be from 0.01 to 100", time_scale=time_scale)
    if time_scale is not None and port is not None:
        why = f"--time-scale {time_scale:g} is for the simulated cell; the unit on {port} has its own time"
        raise InputError(why, time_scale=time_scale)
    if where.world is not None and port is not None:
        why = f"--world {where.world} is of the simulated cell; there is none with --port"
        raise InputError(why, option="--world")
    if where.contact:
        if port is not None:
            raise InputError(
                "--cell mujoco is for the simulated cell; there is none with --port", option="--cell"
            )
        from cell.contact.model import load_mujoco

        load_mujoco()
    require_one_camera(images, camera)
    for option, given in (("--images", images), ("--camera", camera)):
        if port is None and given is not None:
            raise InputError(f"{option} needs --port: the simulated cell has its own camera", option=option)
    if port is None:
        world_file(task, where.world)
    elif where.blind:
        pass
    elif images is not None:
        NewImageFolder(images)
    elif (selector := device_of(live) if camera in (None, OF_CELL) else camera) is None:
        raise InputError(
            "--port needs a camera: name one with --camera, with A465_CAMERA or in the cell file (device under "
            "[look.basler] or [look.video]), or give a folder of images with --images",
            port=port,
        )
    else:
        require_live(live, selector)


@contextmanager
def open_cell(task: Task, where: WhichCell, log: Path) -> Iterator[Connection]:
    """Open the real cell if there is a port, else the simulated one; log everything sent and received.

    Raises:
        InputError: port, world file or camera is missing.
    """
    require_openable(task, where)
    unit = task.cell.unit
    if where.port is None:
        from driver.emulator import Emulator

        simulated, time_scale = (
            simulated_cell(task, where.world, where.contact),
            where.time_scale or TIME_SCALE,
        )
        stepped = SteppedClock(time_scale)  # independent of the host's load
        with Emulator(task.cell.nominal_unit, stepped, plant=simulated) as emulator:
            frames = join(simulated, emulator)
            with WireLog(log, stepped) as wire, Mars(emulator.open_line(), unit, stepped, wire) as mars:
                yield Connection(mars, frames, time_scale, simulated, emulator)
        return
    clock = Clock()
    # the camera is opened before anything is sent, and closed after the arm was commanded to stop
    with _frames(task, where) as source, WireLog(log, clock) as wire:
        try:
            opened = Mars(where.port, unit, clock, wire)
        except InputError:
            os.truncate(log, 0)  # nothing was sent, so no run is kept
            raise
        with opened as mars:
            yield Connection(mars, source, 1.0)


def _frames(task: Task, where: WhichCell) -> AbstractContextManager[FrameSource]:
    """The source of the real cell's images."""
    if where.blind:
        return nullcontext(NoImages())
    if where.images is not None:
        return nullcontext(NewImageFolder(where.images))
    return open_camera(task.cell, where.camera)


def simulated_cell(task: Task, world: Path | None, contact: bool = False) -> SimulatedCell:
    """The simulated cell of a task and its world file, as the plant of an emulated unit.

    Raises:
        InputError: there is no world file, it is wrong, or two of its boards stand in one place; `contact`, and MuJoCo
            is not installed.
    """
    from cell.files.world import read_world
    from cell.sim.cell import SimulatedCell
    from cell.sim.made import require_apart, require_on_table

    cell = task.cell
    truth = read_world(world_file(task, world), cell.marker_size)
    require_apart(truth)
    require_on_table(truth, cell.table_z)
    if truth.camera is not None and truth.camera.size != cell.camera.size:
        (w, h), (width, height) = truth.camera.size, cell.camera.size
        rule = (
            f"takes {w} x {h} px, and the cell's camera {width} x {height}: the lens may differ, not its size"
        )
        raise FileInputError(truth.file, "camera", None, rule)
    if not contact:
        work, wires = _true_work(task, truth) if isinstance(task, ProgramTask) else ((), ())
        return SimulatedCell(cell, truth, work, wires)
    from cell.contact.cell import ContactCell

    return ContactCell(cell, truth)


def _true_work(task: ProgramTask, truth: World) -> tuple[tuple[Body, ...], tuple[TrueWire, ...]]:
    """The bodies on the workpiece of a program, where the workpiece truly is, and the wires; none without its board."""
    from cell.sim.touches import TrueWire

    T = task.T_on_work
    if task.board is not None:
        ids = task.board.marker_ids
        on = next((true.T_base_board for true in truth.boards if true.board.marker_ids == ids), None)
        if on is None:
            return (), ()
        T = mul(on, T)
    T = mul(T, transform(rotation(truth.work.work_turned), truth.work.work_off))
    wires = (
        TrueWire(line.name, tuple(body.at(mul(T, body.T_base_body)) for body in line.bodies))
        for line in task.threads
    )
    return task.bodies_at(T), tuple(wires)


def join(simulated: SimulatedCell, emulator: Emulator) -> SimulatedCamera:
    """Give a simulated cell the time and motion of its emulated unit; return the camera that sees the unit's arm."""
    simulated.now_ms, simulated.record = emulator.now_ms, emulator.record
    simulated.follow(emulator.last_motion)
    return _camera(simulated, emulator.counts)


def camera_at_start(task: Task, world: Path | None) -> SimulatedCamera:
    """The camera of the simulated cell, with the arm at q_start.

    Raises:
        InputError: as `simulated_cell`.
    """
    counts = task.cell.unit.counts(task.cell.q_start)
    return _camera(simulated_cell(task, world), lambda: counts)


def target_camera(task: Task, world: Path | None, rng: np.random.Generator) -> TargetCamera:
    """The camera of the simulated cell, before which a person holds a target; ideal if there is no world file.

    Raises:
        InputError: the world file is wrong, or `world` does not exist.
    """
    from cell.files.world import read_world
    from cell.sim.target_photos import TargetCamera

    cell, file = task.cell, task.file.with_suffix(".world.toml")
    if world is None and not file.exists():
        return TargetCamera(cell.camera, None, rng)
    truth = read_world(world_file(task, world), cell.marker_size)
    return TargetCamera(cell.nominal_camera, truth, rng)


def _camera(simulated: SimulatedCell, counts: Callable[[], npt.ArrayLike]) -> SimulatedCamera:
    from cell.sim.camera import SimulatedCamera

    camera = simulated.world.camera or simulated.cell.nominal_camera
    return SimulatedCamera(simulated, camera, counts, simulated.cell.dictionary)
