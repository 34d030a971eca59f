"""``a465 new-cell``: write a complete cell to start from, which works in simulation at once.

Values come from the project's own scenes, comments from `cell.texts.key_texts`.
"""

from __future__ import annotations

import math
import os
import shlex
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from arm.controller.unit import SUFFIX, UNITS, Unit, load_unit
from arm.errors import InputError
from arm.io.keys import Keys
from arm.io.kind import words_of
from arm.io.slips.ports import port_fault
from arm.io.storage import data_file, read_text
from arm.io.toml_reader import read_toml
from cell.config.camera_keys import require_device
from cell.config.cell_file import CellKeys
from cell.console import Console
from cell.export.folder import write_folder
from cell.files.hand_target import HandCharucoKeys
from cell.files.task import Task1Keys, Task2Keys
from cell.files.world import WorldKeys
from cell.session.dialogue import answered
from cell.texts.key_texts import commented
from vision.camera.model import CameraKeys
from vision.camera.video.selector import is_video

Answer = Callable[[], str | None]

UNASKED = "give --unit to be asked nothing"
LONGEST_MM = 1000.0  # of a gripper
PLACEHOLDER = "placeholder"
UNIT_FILE = "unit.toml"
LONGEST_NAME = 60

_FILES: dict[str, tuple[str, str, type[Keys]]] = {
    "cell.toml": ("scenes/cell.toml", "cell", CellKeys),
    "camera.toml": ("scenes/cameras/lab.toml", "camera", CameraKeys),
    "hand.toml": ("scenes/targets/hand.toml", "target", HandCharucoKeys),
    "task1.toml": ("scenes/task1.toml", "task", Task1Keys),
    "task1.world.toml": ("scenes/task1.world.toml", "world", WorldKeys),
    "task2.toml": ("scenes/task2.toml", "task", Task2Keys),
    "task2.world.toml": ("scenes/task2.world.toml", "world", WorldKeys),
}
"""Source of each file of a new cell: scene file with its values, name of its texts, declaration of its keys."""


@dataclass(frozen=True)
class Own:
    """What only the owner of a cell knows.

    Attributes:
        unit: the arm; the file of a user's own one is copied into the cell.
        port: of the controller, as the cell file has it; None: not known yet.
        camera: selector of the camera; None: not known yet.
        length_mm: of the gripper, from the flange to the finger tips; None: the shipped one's.
    """

    unit: Unit
    port: str | None = None
    camera: str | None = None
    length_mm: float | None = None


def new_cell_step(
    folder: Path, unit: str | None, name: str | None, console: Console, answer: Answer | None = None
) -> dict[str, Any]:
    """Write a cell to a new or empty folder, completely or not at all, and print the next steps.

    Args:
        folder: folder to write.
        unit: name of the arm, which cannot be detected, or its unit file; None: ask for it, and for what else only the
            owner knows.
        name: name of the cell, for the heads of its files; default: that of the folder.
        console: output.
        answer: returns a line that a person typed, or None if nobody can; without it nothing is asked.

    Raises:
        InputError: unit or name is wrong or missing, or the folder cannot be written.
    """
    known = None if unit is None else Own(_unit(unit))
    place = folder.resolve()
    _require_free(folder, place)
    title = place.name if name is None else name
    if not title.strip() or len(title) > LONGEST_NAME or not title.isprintable():
        why = f"--name {title!r}: must be a line of 1 to {LONGEST_NAME} printable characters"
        raise InputError(why, name=title)
    own = known or _asked(folder, console, answer)
    texts = cell_files(own, title)
    write_folder(place, texts)
    console.say(
        f"{folder}: cell {title!r} with arm {own.unit.name}, {len(texts)} files; their comments say what to measure"
    )
    if place.suffix == ".toml":
        console.say(
            f"note: {folder} is a folder, though its name ends as a file's does; did you mean {folder.with_suffix('')}?"
        )
    commands = next_commands(folder, own.unit.name)
    console.say(
        "\nWithout hardware, docs/first-day.md leads to an executed run of this cell beside an emulated unit. With the "
        "arm: next steps; the first three need no hardware, docs/real-cell.md explains the others:"
    )
    for why, line in commands:
        console.say(f"\n# {why}" + (f"\n{line}" if line else ""))
    return {
        "folder": str(folder),
        "name": title,
        "unit": own.unit.name,
        "files": sorted(texts),
        "next": [{"why": why, "command": line} for why, line in commands],
    }


def _asked(folder: Path, console: Console, answer: Answer | None) -> Own:
    """Ask for what only the owner of the cell knows; an empty line leaves what is optional as it is.

    Raises:
        InputError: nobody answers, or no answer is right after `TRIES`.
    """
    unit = None
    if answer is not None:
        console.say("Only you know the following; every answer can be changed in cell.toml later.")
        unit = answered(
            console,
            f"arm ({' or '.join(UNITS)}, as its label says; or a unit file): ",
            _unit,
            answer,
            UNASKED,
        )
    if unit is None or answer is None:
        raise InputError(
            f"--unit is missing: must be {' or '.join(UNITS)}, or a unit file; the controller cannot report it, and "
            f"with the other unit's zeros angles are wrong by up to 11 degrees{_is_unit(folder)}",
            option="--unit",
            choices=list(UNITS),
        )
    port = answered(
        console,
        "port of its controller, such as /dev/mars (Enter: not yet): ",
        lambda line: _port(line, folder),
        answer,
        UNASKED,
    )
    question = "camera, such as name:camera-crs93 or video:0 (Enter: not yet): "
    camera = answered(console, question, _camera, answer, UNASKED)
    tool = read_toml(data_file("scenes/cell.toml"))["tool"]
    length = answered(
        console,
        f"gripper, flange to finger tips in mm (Enter: as shipped, {tool['length_mm']:g}): ",
        lambda line: _length(line, tool["finger_mm"][2] + tool["palm_mm"][2]),
        answer,
        UNASKED,
    )
    return Own(unit, port, camera, length)


def _is_unit(folder: Path) -> str:
    """Say that the name of a folder is that of a unit; "" if it is not."""
    unit = folder.name.lower()
    return f"; {folder} is read as the folder: a465 new-cell my-cell --unit {unit}" if unit in UNITS else ""


def _unit(text: str) -> Unit:
    if text.endswith(SUFFIX):
        return load_unit(Path(text))
    if text not in UNITS:
        meant = text.strip().lower()
        help = f"; did you mean {meant}?" if meant in UNITS else ""
        raise InputError(
            f"--unit {text}: must be one of {', '.join(UNITS)}, or a unit file (.toml){help}", unit=text
        )
    return load_unit(text)


def _port(name: str, folder: Path) -> str:
    """Return a port as the cell file has it: a device that is no absolute path is relative to that."""
    if fault := port_fault(name):
        raise InputError(f"port {name!r}: {fault}", port=name)
    return name if "://" in name or name.startswith("/") else os.path.relpath(name, folder.resolve())


def _camera(selector: str) -> str:
    require_device(selector)
    return selector


def _length(text: str, least_mm: float) -> float:
    """Return the length of a gripper; its fingers and palm, `least_mm`, fit into it."""
    try:
        length = float(text)
    except ValueError:
        length = math.nan
    if not least_mm <= length <= LONGEST_MM:
        why = f"gripper {text!r}: must be a number from {least_mm:g} (fingers and palm) to {LONGEST_MM:g} mm"
        raise InputError(why, length=text)
    return length


def cell_files(own: Own, name: str) -> dict[str, str]:
    """Return the text of every file of a new cell, by its name in the folder."""
    scenes = {file: read_toml(data_file(scene)) for file, (scene, _, _) in _FILES.items()}
    cell = scenes["cell.toml"]
    cell |= {"unit": UNIT_FILE if own.unit.source else own.unit.name, "camera": "camera.toml"}
    if own.port is not None:
        cell["port"] = own.port
    if own.camera is not None:
        cell["look"]["video" if is_video(own.camera) else "basler"] = {"device": own.camera}
    if own.length_mm is not None:
        cell["tool"]["length_mm"] = own.length_mm
    scenes["camera.toml"]["calibration"] = {"id": PLACEHOLDER}
    texts = {file: commented(values, *_FILES[file][1:], name) for file, values in scenes.items()}
    for board in scenes["cell.toml"]["boards"]["files"]:
        texts[board] = read_text(data_file(f"scenes/{board}"))
    if own.unit.source:
        texts[UNIT_FILE] = own.unit.source
    return texts


def next_commands(folder: Path, unit: str) -> list[tuple[str, str]]:
    """Return the next steps of a user with a real cell, in the order of docs/real-cell.md.

    Returns:
        Pairs of purpose and command; the command is empty where a page has to be followed.
    """

    def at(name: str) -> str:
        return shlex.quote(str(folder / name))

    task, hand, look, plan = (at(name) for name in ("task2.toml", "hand.toml", "look.json", "plan.json"))
    camera = "--camera name:MY-CAMERA"
    arm = f"--port /dev/mars {camera}"
    homed = f"{arm} --homed --speed 0.1"
    return [
        ("try it: move four cubes in the simulated cell", f"a465 run {task}"),
        (
            f"measure, edit {at('cell.toml')}, and list the closest bodies at a configuration; compare the assumed "
            "bodies with the arm (docs/real-cell.md, step 2)",
            f"a465 check {at('cell.toml')} --q=-60,-40,-80,0,-60,0",
        ),
        (
            "rehearse the calibration",
            f"a465 calibrate hand-eye {at('rehearsal.json')} --collect {task} --target {hand}",
        ),
        (
            "record how the controller answers, nothing moves; send the file to the maintainers (docs/real-cell.md, "
            "step 3)",
            f"a465 record /dev/mars -o {at('unit.json')}",
        ),
        (
            f"check the installation and devices (a465 cannot verify that the arm is {unit})",
            f"a465 doctor --cell {task} {arm}",
        ),
        (
            "remove everything within the arm's reach, boards too, and home once (docs/real-cell.md, step 4); --homed "
            "below states that the unit was homed and stayed on",
            f"a465 home {at('cell.toml')} /dev/mars --speed 0.1",
        ),
        ("print the lens target at 100 %", f"a465 calibrate target -o {at('lens-target.svg')}"),
        (
            f"calibrate the lens; then name {at('lens.toml')} in the cell file, and write the camera's approximate "
            "pose into it (docs/real-cell.md, step 5)",
            f"a465 calibrate camera {at('lens')} --live {camera} -o {at('lens.toml')}",
        ),
        (
            "print the target for the gripper at 100 %",
            f"a465 calibrate target {hand} -o {at('hand-target.svg')}",
        ),
        (
            "close the jaws on that target; emergency stop at hand",
            f"a465 gripper close {at('cell.toml')} /dev/mars",
        ),
        (
            "clear the table, and let the arm show the target to the camera (docs/real-cell.md, step 6)",
            f"a465 calibrate hand-eye {at('recorded.json')} --collect {task} --target {hand} "
            f"{homed} -o {at('calibration.toml')} --apply",
        ),
        (
            "take the target out, set up boards and cubes, and detect them",
            f"a465 look {task} {camera} -o {look} --picture {at('look.png')}",
        ),
        (
            f"raise clearance_mm in {at('cell.toml')} by the errors listed in docs/real-cell.md, step 7; then plan",
            f"a465 plan {task} --look {look} -o {plan}",
        ),
        (
            "preview the plan in a browser; the page shows the code that execute needs",
            f"a465 preview {plan} {task} -o {at('plan.html')}",
        ),
        ("execute slowly first", f"a465 execute {plan} {task} {homed}"),
        (
            "tick off what must be true before the arm may run unattended; it asks what only you can see "
            "(docs/real-cell.md, step 9)",
            f"a465 doctor --cell {at('cell.toml')} {arm} --ask -o {at('checklist.html')}",
        ),
        ("do it all in one command", f"a465 run {task} {homed}"),
    ]


def _require_free(folder: Path, place: Path) -> None:
    """Refuse a folder that is not empty or cannot be replaced."""
    if place == Path.cwd():
        why = f"{folder}: is the current folder and cannot be replaced; give a new one, such as my-cell"
        raise InputError(why, folder=str(folder))
    try:
        held = sorted(os.listdir(place)) if os.path.lexists(place) else []
    except OSError as error:
        what = error.strerror if place.is_dir() else f"it is {words_of(place)}; give a new or an empty folder"
        raise InputError(f"{folder}: is not a usable folder: {what}", folder=str(folder)) from error
    if held:
        why = f"{folder}: is not empty ({held[0]}); give a new or an empty folder"
        raise InputError(why, folder=str(folder), holds=held[0])
