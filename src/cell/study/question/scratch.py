"""The files of a study, with the values of one point at a time: what every stage reads, as a person would write it."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from importlib.metadata import version
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import arm
from arm.errors import FileInputError, InputError
from arm.io.rules import is_number
from arm.io.storage import (
    MOST_BYTES,
    canonical_json,
    data_file,
    files_read,
    read_bytes,
    read_instead,
    read_text,
    sha256,
)
from arm.io.temporary import TemporaryFolder
from cell.files.study import Study, Varied, read_study
from cell.files.task import KINDS, Task, read_task
from cell.files.world import World, read_world
from cell.session.camera_watch import camera_watch
from cell.study.question.edit import NOT_THERE, Template, has_key
from cell.study.question.points import points_of

_LARGEST = max(MOST_BYTES, key=lambda kind: MOST_BYTES[kind])
PACKAGES = ("arm", "plan", "vision", "render", "driver", "calib", "cell")
_LEAST_MM = 10.0  # of a value in the file by which the unit of a study's values is judged
LIBRARIES = (
    *("numpy", "scipy", "pin", "coal", "qpsolvers", "daqp", "osqp", "piqp"),
    *("toppra", "ruckig", "opencv-python-headless"),
)
"""Which compute; the others of the program only read, print and talk."""


@dataclass(frozen=True)
class Bundle:
    """All files that a study reads, to send to whoever computes a part of it.

    Attributes:
        files: content by the path below their common folder.
        study, task, world, cell, camera: paths of these files there.
        code: see `code_digest`.
    """

    files: Mapping[str, bytes]
    study: str
    task: str
    world: str
    cell: str
    camera: str
    code: str

    @cached_property
    def digest(self) -> str:
        """Hash of everything that the results depend on."""
        files = {name: sha256(content) for name, content in self.files.items() if name != self.study}
        return sha256(canonical_json([files, self.code]))

    def write(self, folder: Path) -> Study:
        """Write the files below a folder; return the study with its paths there."""
        for name, content in self.files.items():
            path = folder / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(content)
        # the study file may name the others by absolute paths
        return read_study(folder / self.study, folder / self.task, folder / self.world)


def bundle_of(study: Study) -> Bundle:
    """Read the files of a study once.

    Raises:
        InputError: a file is wrong, a varied value has no place in it, or neither the first nor the last point has
            values that the files may have.
    """
    with files_read() as read:
        task, world = _read_whole(study)
        ends = [study.task, study.world, task.cell.file, task.cell.camera_file]
        _require_used(study, task, world)
        templates = _Templates(study, _varied_files(*ends))
        for changed in templates.naming_files(study):
            try:
                with read_instead(changed):
                    _read_whole(study)
            except InputError as error:
                if isinstance(error.__cause__, OSError):  # a file that a value names is not there
                    raise
                # any other wrong value is a refusal of its points
    own = data_file("urdf").resolve()
    paths = dict.fromkeys(Path(os.path.abspath(path)) for path in [study.file, *ends, *read])
    files = [path for path in paths if own not in path.resolve().parents]
    root = Path(os.path.commonpath([path.parent for path in files]))
    names = {path: path.relative_to(root).as_posix() for path in files}
    study_name, task_name, world_name, cell_name, camera_name = (
        names[Path(os.path.abspath(path))] for path in (study.file, *ends)
    )
    contents = {name: read_bytes(path, _LARGEST) for path, name in names.items()}
    bundle = Bundle(contents, study_name, task_name, world_name, cell_name, camera_name, code_digest())
    with TemporaryDirectory(prefix="a465-study-") as folder:
        _require_values(Scratch(bundle, Path(folder)), _varied_files(*ends))
    return bundle


def _read_whole(study: Study) -> tuple[Task, World]:
    """Read all files that the stages of a study read."""
    task, world = _read(study.task, study.world)
    if {"look", "run"} & set(study.stages):
        camera_watch(task.cell)  # reads the background
    return task, world


def _require_used(study: Study, task: Task, world: World) -> None:
    """Refuse a cell or camera file that varies and is not used, at some points or at all."""
    varying = {(one.file, one.key): one.name for one in study.vary}
    inside = {one.file for one in study.vary}
    naming = {
        "cell": [("task", "cell")],
        "camera": [("task", "cell"), ("cell", "camera"), ("cell", "calibration")],
    }
    for file, places in naming.items():
        for place in places:
            if file in inside and place in varying:
                why = (
                    f"{study.file.name}: vary: {varying[place]} says which {file} file is used, so a key of one cannot "
                    "vary too; ask two studies"
                )
                raise InputError(why, file=str(study.file), key="vary")
    if "camera" not in inside:
        return
    if task.cell.calibration is not None:
        why = (
            f"{task.cell.file.name}: calibration must be left out: it replaces what varies of the camera file"
        )
        raise InputError(why, file=str(task.cell.file), key="calibration")
    if world.camera is not None:
        why = f"{study.world.name}: camera must be left out: it takes the images instead of the camera that varies"
        raise InputError(why, file=str(study.world), key="camera")


def _require_values(scratch: Scratch, files: Mapping[str, Path]) -> None:
    """Refuse a study if neither its first nor its last point has values that the files may have.

    Args:
        scratch: the study in copies.
        files: those that were copied, as of `_varied_files`.
    """
    study = scratch.study
    for number in (0, study.count - 1):
        try:
            scratch.set(points_of(study, number, 1)[0])
        except InputError as error:
            wrong = error
        else:
            return
    help = next((f" ({words})" for one in study.vary if (words := _elsewhere(one.file, one.key, files))), "")
    if not help and "whole number" in str(wrong) and any(not one.grid for one in study.vary):
        help = " (a range without steps is sampled, with fractions: give steps, or values)"
    raise InputError(
        f"{study.file.name}: neither the first nor the last point has values that the files may have; the last: "
        f"{wrong}{help}",
        **wrong.data,
    ) from wrong


def _varied_files(task: Path, world: Path, cell: Path, camera: Path) -> dict[str, Path]:
    return {"task": task, "world": world, "cell": cell, "camera": camera}


def _elsewhere(kind: str, key: str, files: Mapping[str, Path]) -> str:
    """Say which other file has a key that the file of a kind has not; "" if none has it."""
    having = [one for one, file in files.items() if has_key(file, read_text(file, "TOML"), key)]
    if kind in having or not having:
        return ""
    return f'{files[having[0]].name} has {key}: write file = "{having[0]}" into that [[vary]]'


def _read(task_file: Path, world_file: Path) -> tuple[Task, World]:
    task = read_task(task_file)
    if task.kind not in KINDS:
        raise InputError(
            f"{task_file}: is not a task of boards and cubes; a study asks such a task", file=str(task_file)
        )
    return task, read_world(world_file, task.cell.marker_size)


def code_files() -> list[Path]:
    """Return the files of the program that results may depend on."""
    source = Path(arm.__file__).resolve().parents[1]
    files = [path for name in PACKAGES for path in sorted((source / name).rglob("*.py"))]
    return files + sorted(path for path in data_file("urdf").rglob("*") if path.is_file())


@cache
def code_digest() -> str:
    """Return a hash of the modules of all packages, of the URDF and unit files, and of the versions of libraries.

    It is taken once in a process: a process that goes on for days computes with the modules that it began with.
    """
    files = code_files()
    versions = [sys.version, *(version(name) for name in LIBRARIES)]
    return sha256(canonical_json([*versions, *(sha256(path.read_bytes()) for path in files)]))


class _Templates:
    """The files that vary, with places for the values."""

    def __init__(self, study: Study, files: Mapping[str, Path]) -> None:
        self._made = []
        for kind, file in files.items():
            at = [k for k, one in enumerate(study.vary) if one.file == kind]
            if at:
                template = _template(kind, files, [study.vary[k].key for k in at])
                for number, k in enumerate(at):
                    _require_unit(study, study.vary[k], template.stated(number), file)
                self._made.append((file, template, at))

    def naming_files(self, study: Study) -> Iterator[dict[Path, bytes]]:
        """Yield a file with each value that may be another file's name, the others as at point 0."""
        values = list(points_of(study, 0, 1)[0])
        for file, template, at in self._made:
            for k in at:
                for value in study.vary[k].grid if _has_text(study.vary[k].grid) else ():
                    others = [value if other == k else values[other] for other in at]
                    yield {file: template.text(others).encode()}

    def write(self, values: Sequence[Any]) -> None:
        for file, template, at in self._made:
            file.write_bytes(template.text([values[k] for k in at]).encode())


def _template(kind: str, files: Mapping[str, Path], keys: Sequence[str]) -> Template:
    """Return the template of the file of a kind; say which other file has a key that it has not."""
    try:
        return Template(files[kind], read_text(files[kind], "text"), keys)
    except FileInputError as error:
        key = error.data["key"]
        if error.data["rule"] == NOT_THERE and (help := _elsewhere(kind, key, files)):
            raise FileInputError(files[kind], key, None, NOT_THERE, help) from error
        raise


def _require_unit(study: Study, one: Varied, stated: Any, file: Path) -> None:
    """Refuse values in metres of a key in mm, told by the file's own value: all are near a thousandth of it."""
    values = one.grid or (one.low, one.high)
    if "_mm" not in one.key or not all(is_number(value) for value in (stated, *values)):
        return
    sizes, there = [abs(value) for value in values if value], abs(stated)
    if sizes and there >= _LEAST_MM and 0.3 * there <= 1e3 * min(sizes) <= 1e3 * max(sizes) <= 3.0 * there:
        why = (
            f"{study.file}: {one.name}: {min(sizes):g} to {max(sizes):g} are not near the {there:g} of {file.name}; "
            f"{one.key} is in mm: are these metres?"
        )
        raise InputError(why, file=str(study.file), key=one.key)


def _has_text(value: Any) -> bool:
    return any(map(_has_text, value)) if isinstance(value, list | tuple) else isinstance(value, str)


class Scratch:
    """The files of a study in a folder of their own.

    Args:
        bundle: the files.
        folder: an empty folder.

    Attributes:
        study: the study, with its paths in that folder.
    """

    def __init__(self, bundle: Bundle, folder: Path) -> None:
        self._folder = folder
        try:
            self.study = bundle.write(folder)
        except OSError as error:
            why = f"{folder}: cannot be written: {error.strerror}"
            raise InputError(why, file=str(folder)) from error
        with files_read() as read:
            self.task, self.world = _read_whole(self.study)
        self._require_copies(read)
        self._read_again = {one.file for one in self.study.vary}
        cell, camera = folder / bundle.cell, folder / bundle.camera
        files = _varied_files(self.study.task, self.study.world, cell, camera)
        self._templates = _Templates(self.study, files)

    def _require_copies(self, read: Iterable[Path]) -> None:
        """Refuse a file that is named by an absolute path: a study reads the copies that it changes and sends."""
        own = (self._folder.resolve(), data_file("urdf").resolve())
        for path in read:
            if not any(folder in path.resolve().parents for folder in own):
                why = (
                    f"{path}: a study reads copies of its files, on other machines too: the file that names it must "
                    "name it by a relative path"
                )
                raise InputError(why, file=str(path))

    def set(self, values: Sequence[Any]) -> None:
        """Write the values of a point into the files, and read them.

        Raises:
            InputError: a value is wrong there; names the file without the folder of the copy, key, value and rule.
        """
        try:
            self._templates.write(values)
            if self._read_again != {"world"}:
                with files_read() as read:
                    self.task, self.world = _read(self.study.task, self.study.world)
                self._require_copies(read)
            else:
                self.world = read_world(self.study.world, self.task.cell.marker_size)
        except OSError as error:
            why = f"{self._folder}: cannot be written: {error.strerror}"
            raise InputError(why, file=str(self._folder)) from error
        except InputError as error:
            data = {
                name: self.named(one) if isinstance(one, str) else one for name, one in error.data.items()
            }
            raise InputError(self.named(str(error)), **data) from (error.__cause__ or error)

    def named(self, text: str) -> str:
        """Return a text with its files named as below the common folder: that of the copy differs each time."""
        return text.replace(f"{self._folder}{os.sep}", "")


def write_point(study: Study, bundle: Bundle, number: int, folder: Path) -> Path:
    """Write the files of one point below a new folder, all or none; return the path of its task file.

    Args:
        study: the study.
        bundle: its files, as they were when its points were computed.
        number: of the point.
        folder: to write.

    Raises:
        InputError: there is no such point, the folder is there or cannot be written, or a value is wrong.
    """
    if not 0 <= number < study.count:
        raise InputError(f"point = {number}: must be 0 to {study.count - 1}", point=number)
    if folder.exists():
        raise InputError(f"{folder}: is there already; give a new folder", file=str(folder))
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        with TemporaryFolder(folder) as made:
            Scratch(bundle, made.path).set(points_of(study, number, 1)[0])
            (made.path / bundle.study).unlink()
            made.become()
    except OSError as error:
        raise InputError(f"{folder}: cannot be written: {error.strerror}", file=str(folder)) from error
    return folder / bundle.task
