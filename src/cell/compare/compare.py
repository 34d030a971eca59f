"""``a465 compare``: what changed from one cell, task, calibration or plan file to another, in their own terms."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from filecmp import cmp
from pathlib import Path
from typing import Any

import numpy as np

from arm.calibration_file import COVARIANCE, ArmCalibration, read_arm_calibration
from arm.controller.unit import SUFFIX
from arm.errors import FileInputError, InputError
from arm.io.kind import KINDS, kind_of, kind_of_file, read_any
from arm.io.node import Node
from arm.io.storage import begins_as_object
from arm.numerics.products import mul, norm
from arm.plan_file import Move, Plan, read_plan
from arm.se3 import Array, inverse, rotation_vector
from cell.config.inputs import config_inputs
from cell.console import Console
from vision.camera.model import Camera, read_intrinsics

FOLLOWED = ("cell", "unit", "camera", "calibration")  # keys that name a file which is compared too
COMPARED = "cell, task, program, arm, calibration, camera and plan files can"
LONGEST = 36  # characters of a value in the table
SAME = 1e-12  # rad, m or px: numbers that differ by less are the same
_DEG = 180.0 / np.pi
_LENS = ("fx px", "fy px", "cx px", "cy px", "k1", "k2", "p1", "p2", "k3")


@dataclass(frozen=True)
class Change:
    """One difference.

    Attributes:
        what: key, or name of the number with its unit.
        first, second: values; None: not given.
        by: change of a number; None for others.
        sd: standard deviation of that change, by the errors of both; None if not known.
        file: in which it is; "" for the files that were given.
    """

    what: str
    first: Any = None
    second: Any = None
    by: float | None = None
    sd: float | None = None
    file: str = ""


def compare_step(first: Path, second: Path, console: Console) -> dict[str, Any]:
    """Print the differences of two files of one kind, and return them as JSON types.

    Raises:
        InputError: a file cannot be read, or the two are of different kinds.
    """
    found = list(differences(first, second))
    columns: dict[str, list[Any]] = {
        "file": [c.file for c in found],
        "what": [c.what for c in found],
        "first": [_shown(c.first) for c in found],
        "second": [_shown(c.second) for c in found],
        "change": [_number(c.by) for c in found],
        "sd": [_number(c.sd) for c in found],
    }
    used = {
        name: values for name, values in columns.items() if any(value not in ("", None) for value in values)
    }
    if found:
        console.table(tuple(used), list(zip(*used.values(), strict=True)))
    if first.samefile(second):
        console.say(f"NOTE: {first} and {second} are the same file")
    count = f"{len(found)} difference{'' if len(found) == 1 else 's'}"
    console.say(f"{first} and {second}: {count if found else 'no difference'}")
    return {
        "first": str(first),
        "second": str(second),
        "same": not found,
        "changes": [vars(c) for c in found],
    }


def differences(first: Path, second: Path, file: str = "") -> Iterator[Change]:
    """Yield the differences of two files of one kind; `file` is the name of a file that both name.

    Raises:
        InputError: see `compare_step`.
    """
    kind, other = _kind(first), _kind(second)
    if kind != other:
        what, others = (_words(one, of) for one, of in ((first, kind), (second, other)))
        why = f"{first} is {what}, {second} is {others}; must be two of a kind"
        raise InputError(why, first=kind, second=other)
    match kind:
        case "plan":
            yield from _of_plans(read_plan(first), read_plan(second))
        case "calibration":
            then, now = read_arm_calibration(first), read_arm_calibration(second)
            yield from (replace(change, file=file) for change in _of_calibrations(then, now))
        case "camera":
            before, after = read_intrinsics(first), read_intrinsics(second)
            yield from (replace(change, file=file) for change in _of_cameras(before, after))
        case _:
            yield from _of_files(first, second, file)


def _kind(path: Path) -> str:
    """Return what a file is."""
    if begins_as_object(path):
        if (found := kind_of(read_any(path))) not in ("", "plan"):
            raise FileInputError(
                path, "", None, f"is {KINDS[found].words}, which cannot be compared", COMPARED
            )
        return "plan"
    root = Node.of_toml(path)
    known = {"T_base_camera": "calibration", "intrinsics": "camera", "q_start_deg": "cell"}
    shown = (known.get(name, name) for name in (*known, "task", "program", "arm") if name in root)
    return next(shown, kind_of(root.value) or "other")


def _words(path: Path, kind: str) -> str:
    """Return what a file is, in words."""
    return KINDS[found].words if (found := kind_of_file(path) or kind) in KINDS else "another file"


def _of_files(first: Path, second: Path, file: str) -> Iterator[Change]:
    """Yield the keys that differ, then what differs in the files that both name."""
    then, now = Node.of_toml(first), Node.of_toml(second)
    for change in _of_keys(config_inputs(then.value), config_inputs(now.value)):
        if change.what not in FOLLOWED and not _same_files(change, first.parent, second.parent):
            yield replace(change, file=file)
    for name in FOLLOWED:
        values = then.value.get(name), now.value.get(name)
        if all(isinstance(one, str) and (name != "unit" or one.endswith(SUFFIX)) for one in values):
            before, after = first.parent / then.value[name], second.parent / now.value[name]
            yield from differences(before, after, after.name)
        elif values[0] != values[1]:
            yield Change(name, *values, file=file)


def _same_files(change: Change, first: Path, second: Path) -> bool:
    """Whether two values name files, or lists of files, of the same content, seen from two folders."""
    then, now = ([value] if isinstance(value, str) else value for value in (change.first, change.second))
    if not (isinstance(then, list) and isinstance(now, list) and len(then) == len(now) > 0):
        return False
    if not all(isinstance(name, str) for name in (*then, *now)):
        return False
    files = [(first / a, second / b) for a, b in zip(then, now, strict=True)]
    return all(a.is_file() and b.is_file() and cmp(a, b, shallow=False) for a, b in files)


def _of_keys(first: Mapping[str, Any], second: Mapping[str, Any]) -> Iterator[Change]:
    for key in sorted(first.keys() | second.keys()):
        if first.get(key) != second.get(key):
            yield Change(key, first.get(key), second.get(key))


def _of_calibrations(first: ArmCalibration, second: ArmCalibration) -> Iterator[Change]:
    """Yield what the second calibration has changed: camera, joints, links, lens."""
    if first.unit != second.unit:
        yield Change("unit", first.unit, second.unit)
    sd = _deviations(first.covariance, second.covariance, sum(COVARIANCE))
    yield from _of_poses(first.T_base_camera, second.T_base_camera, sd[:6])
    links, other = first.links, second.links
    for number, (name, then, now, scale) in enumerate(
        (
            ("offset deg", first.joint_offsets, second.joint_offsets, _DEG),
            ("link d mm", links.d, other.d, 1e3),
            ("link a mm", links.a, other.a, 1e3),
            ("link alpha deg", links.alpha, other.alpha, _DEG),
        )
    ):
        names = [f"J{k} {name}" for k in range(1, 7)]
        yield from _of_numbers(names, scale * then, scale * now, scale * sd[6 + 6 * number : 12 + 6 * number])
    if first.intrinsics is not None and second.intrinsics is not None:
        yield from _of_numbers(_LENS, first.intrinsics, second.intrinsics, sd[30:])


def _of_cameras(first: Camera, second: Camera) -> Iterator[Change]:
    """Yield what the second camera file has changed: lens and pose."""
    if first.size != second.size:
        yield Change("size px", list(first.size), list(second.size))
    sd = _deviations(first.lens_covariance, second.lens_covariance, 9)
    then, now = (np.append(c.K[[0, 1, 0, 1], [0, 1, 2, 2]], c.distortion) for c in (first, second))
    yield from _of_numbers(_LENS, then, now, sd)


def _of_poses(first: Array, second: Array, sd: Array) -> Iterator[Change]:
    """Yield how far a camera moved; `sd` is of the twist, (6,)."""
    T = mul(inverse(first), second)
    for name, by, off, scale in (
        ("camera moved mm", T[:3, 3], sd[:3], 1e3),
        ("camera turned deg", rotation_vector(T[:3, :3]), sd[3:], _DEG),
    ):
        if norm(by) > SAME:
            yield Change(name, by=scale * norm(by), sd=_known(scale * norm(off)))


def _of_numbers(names: Sequence[str], first: Array, second: Array, sd: Array) -> Iterator[Change]:
    for name, then, now, off in zip(names, first.tolist(), second.tolist(), sd.tolist(), strict=True):
        if abs(now - then) > SAME:
            yield Change(name, then, now, now - then, _known(off))


def _known(sd: float) -> float | None:
    return None if np.isnan(sd) else sd


def _deviations(first: Array | None, second: Array | None, count: int) -> Array:
    """Return the standard deviations (count,) of the changes of as many numbers; NaN if they are not known."""
    if first is None or second is None:
        return np.full(count, np.nan)
    return np.sqrt(np.diag(first) + np.diag(second))


def _of_plans(first: Plan, second: Plan) -> Iterator[Change]:
    """Yield the differences of two plans: what they are made for, and their motions."""
    if first.sha256 == second.sha256:
        return
    for what, a, b in (
        ("task", first.task.get("name"), second.task.get("name")),
        ("unit", first.unit, second.unit),
        ("speed", first.speed, second.speed),
        ("calibration", first.provenance.get("calibration_id"), second.provenance.get("calibration_id")),
    ):
        if a != b:
            yield Change(what, a, b)
    for part in ("task", "cell", "arm"):
        then, now = ((plan.provenance.get("inputs") or {}).get(part, {}) for plan in (first, second))
        for change in _of_keys(then, now):
            yield replace(change, what=f"{part} file: {change.what}")
    for change in _of_keys(_bodies(first), _bodies(second)):
        yield replace(change, what=f"body {change.what}")
    for what, a, b in (
        ("motion s", _motion_s(first), _motion_s(second)),
        ("least clearance mm", _least_mm(first), _least_mm(second)),
    ):
        if a != b:
            yield Change(what, a, b, b - a)
    names = [[step.name for step in plan.steps] for plan in (first, second)]
    if names[0] != names[1]:
        yield Change("steps", _missing(*names), _missing(*names[::-1]))
        return
    for then, now in zip(first.moves, second.moves, strict=True):
        for what, a, b in (
            ("s", then.path.duration_s, now.path.duration_s),
            ("mm", 1e3 * then.clearance, 1e3 * now.clearance),
        ):
            if a != b:
                yield Change(f"{then.name} {what}", a, b, b - a)


def _bodies(plan: Plan) -> dict[str, str]:
    """Return where each body of a plan's scene is, mm, by name."""
    found = {}
    for body in (*plan.scene.get("bodies", ()), *plan.scene.get("cubes", ())):
        T = np.array(body["T_base_body"])
        found[body["name"]] = "at " + ", ".join(f"{1e3 * v:.2f}" for v in T[:3, 3])
    return found


def _motion_s(plan: Plan) -> float:
    return sum(move.path.duration_s for move in plan.moves)


def _least_mm(plan: Plan) -> float:
    return min((1e3 * step.clearance for step in plan.steps if isinstance(step, Move)), default=float("inf"))


def _missing(names: list[str], others: list[str]) -> str:
    """Return how many steps there are, and the first that the other plan has not."""
    more = [name for name in names if name not in others]
    return f"{len(names)} steps" + (f", {more[0]!r} among them" if more else "")


def _shown(value: Any) -> str:
    text = f"{value:.6g}" if isinstance(value, float) else "-" if value is None else str(value)
    return text if len(text) <= LONGEST else f"{text[: LONGEST - 3]}..."


def _number(value: float | None) -> str | None:
    return None if value is None else f"{value:.3g}"
