"""``a465 new-cell``: write a complete cell to start from, which works in simulation at once.

Values come from the project's own scenes, comments from `cell.texts.key_texts`.
"""

from __future__ import annotations

import os
import shlex
from pathlib import Path
from typing import Any

from arm.controller.unit import UNITS
from arm.errors import InputError
from arm.io.keys import Keys
from arm.io.storage import data_file, read_text
from arm.io.toml_reader import read_toml
from cell.config.cell_file import CellKeys
from cell.console import Console
from cell.export.folder import write_folder
from cell.files.hand_target import HandCharucoKeys
from cell.files.task import Task1Keys, Task2Keys
from cell.files.world import WorldKeys
from cell.texts.key_texts import commented
from vision.camera.model import CameraKeys

PLACEHOLDER = "placeholder"
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


def new_cell_step(folder: Path, unit: str | None, name: str | None, console: Console) -> dict[str, Any]:
    """Write a cell to a new or empty folder, completely or not at all, and print the next steps.

    Args:
        folder: folder to write.
        unit: name of the arm; None is refused, because it cannot be detected.
        name: name of the cell, for the heads of its files; default: that of the folder.

    Raises:
        InputError: unit or name is wrong, or the folder cannot be written.
    """
    if unit is None:
        raise InputError(
            f"--unit is missing: must be {' or '.join(UNITS)}; the controller cannot report it, and with the other "
            "unit's zeros angles are wrong by up to 11 degrees",
            option="--unit",
            choices=list(UNITS),
        )
    if unit not in UNITS:
        raise InputError(f"--unit {unit}: must be one of {', '.join(UNITS)}", unit=unit)
    place = folder.resolve()
    _require_free(folder, place)
    title = place.name if name is None else name
    if not title.strip() or len(title) > LONGEST_NAME or not title.isprintable():
        why = f"--name {title!r}: must be a line of 1 to {LONGEST_NAME} printable characters"
        raise InputError(why, name=title)
    texts = cell_files(unit, title)
    write_folder(place, texts)
    console.say(
        f"{folder}: cell {title!r} with arm {unit}, {len(texts)} files; their comments say what to measure"
    )
    commands = next_commands(folder, unit)
    console.say("\nNext steps; the first three need no hardware, docs/real-cell.md explains the others:")
    for why, line in commands:
        console.say(f"\n# {why}" + (f"\n{line}" if line else ""))
    return {
        "folder": str(folder),
        "name": title,
        "unit": unit,
        "files": sorted(texts),
        "next": [{"why": why, "command": line} for why, line in commands],
    }


def cell_files(unit: str, name: str) -> dict[str, str]:
    """Return the text of every file of a new cell, by its name in the folder."""
    scenes = {file: read_toml(data_file(scene)) for file, (scene, _, _) in _FILES.items()}
    scenes["cell.toml"] |= {"unit": unit, "camera": "camera.toml"}
    scenes["camera.toml"]["calibration"] = {"id": PLACEHOLDER}
    texts = {file: commented(values, *_FILES[file][1:], name) for file, values in scenes.items()}
    for board in scenes["cell.toml"]["boards"]["files"]:
        texts[board] = read_text(data_file(f"scenes/{board}"))
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
        raise InputError(f"{folder}: is not a usable folder: {error.strerror}", folder=str(folder)) from error
    if held:
        why = f"{folder}: is not empty ({held[0]}); give a new or an empty folder"
        raise InputError(why, folder=str(folder), holds=held[0])
