"""Checks of arguments: numbers, joint positions, poses. Errors state name, value, rule and what helps."""

from __future__ import annotations

import re
from collections.abc import Sequence
from math import inf
from numbers import Integral, Real
from typing import Any

import numpy as np
import numpy.typing as npt

from arm.errors import InputError
from arm.numerics.products import mul
from arm.se3 import Array, frozen

RIGID = 1e-6  # tolerance of a pose's axes on unit length and right angles

_HELP_POSE = "make poses with arm.se3.transform(R, t)"


def shown(value: object) -> str:
    """Return a value in short form for messages."""
    if isinstance(value, np.ndarray):
        return f"array of shape {value.shape}"
    if isinstance(value, Real) and not isinstance(value, Integral):
        return f"{float(value):g}"
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."


def number(name: str, value: Any, low: float, high: float, unit: str = "", help: str = "") -> float:
    """Return `value` as a float from `low` to `high`.

    Raises:
        InputError: not a number (a string, boolean or array is not one), NaN, or out of range.
    """
    real = isinstance(value, Real) and not isinstance(value, bool)
    if real and low <= value <= high:
        return float(value)
    of, what = f" {unit}" if unit else "", "" if real else "a number "
    raise InputError(
        f"{name} = {shown(value)}{of if real else ''}: must be {what}from {low:g} to {high:g}"
        + ("" if real else of)
        + (f"; {help}" if help else ""),
        name=name,
        value=float(value) if real else shown(value),
        low=low,
        high=high,
    )


def finite(name: str, value: Any, unit: str = "") -> float:
    """Return `value` as a finite float.

    Raises:
        InputError: not a number, NaN or infinite.
    """
    if isinstance(value, Real) and not isinstance(value, bool) and abs(float(value)) < inf:
        return float(value)
    of = f" in {unit}" if unit else ""
    raise InputError(f"{name} = {shown(value)}: must be a finite number{of}", name=name, value=shown(value))


def integer(name: str, value: Any, low: int) -> int:
    """Return `value` as an integer of at least `low`.

    Raises:
        InputError: not an integer (1.5, a string or a boolean is not one), or below `low`.
    """
    if isinstance(value, bool) or not isinstance(value, Integral) or int(value) < low:
        why = f"{name} = {shown(value)}: must be a whole number, {low} or more"
        raise InputError(why, name=name, value=shown(value), low=low)
    return int(value)


def numbers(value: Any) -> Array | None:
    """Return `value` as an array of floats; None if it is not numeric or its rows differ in length."""
    try:
        array = np.asarray(value)
        return np.asarray(array, dtype=float) if array.dtype.kind in "fiu" else None
    except (TypeError, ValueError):
        return None


def joints(name: str, q: Any, names: Sequence[str]) -> Array:
    """Return q as (n,), one finite number per joint; q may be (1, n).

    Raises:
        InputError: wrong shape, not numeric, or a number that is not finite.
    """
    n, array = len(names), numbers(q)
    if array is not None and array.shape == (1, n):
        array = array[0]
    rule = f"must be {n} finite numbers in rad (m for a prismatic joint), one for each of {', '.join(names)}"
    if array is None or array.shape != (n,):
        raise InputError(f"{name} = {shown(q if array is None else array)}: {rule}", name=name, joints=n)
    if not np.isfinite(array).all():
        at = int(np.argmin(np.isfinite(array)))
        raise InputError(f"{name}: joint {names[at]} = {array[at]:g}: {rule}", name=name, joint=names[at])
    return array


def rigid(name: str, T: Any) -> Array:
    """Return a pose as a read-only 4x4 array; takes about 3 us.

    Raises:
        InputError: not 4x4, not finite, or scaled, skewed or mirrored by more than `RIGID`.
    """
    pose = T if type(T) is np.ndarray and T.dtype == np.float64 else numbers(T)
    if pose is None or pose.shape != (4, 4):
        found = shown(T if pose is None else pose)
        raise InputError(f"{name} = {found}: must be a 4x4 pose; {_HELP_POSE}", name=name)
    (a, b, c, x), (d, e, f, y), (g, h, i, z), (o, p, q, r) = pose.tolist()
    lengths = a * a + d * d + g * g, b * b + e * e + h * h, c * c + f * f + i * i
    askew = abs(a * b + d * e + g * h) + abs(b * c + e * f + h * i) + abs(a * c + d * f + g * i)
    volume = a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g)
    off = abs(lengths[0] - 1.0) + abs(lengths[1] - 1.0) + abs(lengths[2] - 1.0) + askew
    last = abs(o) + abs(p) + abs(q) + abs(r - 1.0)
    # NaN fails this comparison
    if off <= 2.0 * RIGID and volume > 0.0 and last <= RIGID and abs(x) + abs(y) + abs(z) < inf:
        return frozen(pose) if pose.flags.writeable else pose
    raise InputError(f"{name}: {_not_rigid(pose, volume)}; {_HELP_POSE}", name=name, matrix=pose.tolist())


def _not_rigid(pose: Array, volume: float) -> str:
    if not np.isfinite(pose).all():
        return "the pose has a number that is not finite"
    if np.abs(pose[3] - (0.0, 0.0, 0.0, 1.0)).sum() > RIGID:
        return f"the last row of the pose is {pose[3].tolist()}, must be 0 0 0 1"
    lengths = np.linalg.norm(pose[:3, :3], axis=0)
    if np.abs(lengths - 1.0).max() > RIGID:
        return f"the axes of the pose have lengths {', '.join(f'{v:.7g}' for v in lengths)}, must be 1 to {RIGID:g}"
    if volume <= 0.0:
        return "the pose is mirrored: its axes must be right-handed"
    return f"the axes of the pose are not at right angles to {RIGID:g}"


def poses(name: str, T: npt.ArrayLike) -> Array:
    """Return poses (m, 4, 4) from (4, 4) or (m, 4, 4).

    Raises:
        InputError: wrong shape, or a pose that is not rigid (see `rigid`).
    """
    array = numbers(T)
    if array is None or array.ndim not in (2, 3) or array.shape[-2:] != (4, 4):
        found = shown(T if array is None else array)
        raise InputError(f"{name} = {found}: must be 4x4, or (m, 4, 4) for m poses; {_HELP_POSE}", name=name)
    every = array.reshape(-1, 4, 4)
    R = every[:, :3, :3]
    with np.errstate(invalid="ignore", over="ignore"):
        off = np.abs(mul(np.swapaxes(R, 1, 2), R) - np.eye(3)).sum(axis=(1, 2))
        # the last axis of a right-handed rotation is the cross product of the others
        off = np.maximum(off, np.abs(np.cross(R[:, :, 0], R[:, :, 1]) - R[:, :, 2]).max(axis=1))
        off = np.maximum(off, np.abs(every[:, 3] - (0.0, 0.0, 0.0, 1.0)).max(axis=1))
        fine = (off <= RIGID) & np.isfinite(every[:, :3, 3]).all(axis=1)
    for i in np.flatnonzero(~fine).tolist():  # `rigid` decides borderline cases
        rigid(name if array.ndim == 2 else f"{name}[{i}]", every[i])
    return every


def pairs(name: str, value: Any) -> frozenset[frozenset[str]]:
    """Return `value` as a set of unordered pairs of different names.

    Raises:
        InputError: a name instead of a pair, or a pair without two different names.
    """
    rule = 'must be pairs of two names, such as [("finger_l", "table")]'
    if isinstance(value, str) or not hasattr(value, "__iter__"):
        raise InputError(f"{name} = {shown(value)}: {rule}", name=name)
    found = set()
    for pair in value:
        one = frozenset() if isinstance(pair, str) or not hasattr(pair, "__iter__") else frozenset(pair)
        if len(one) != 2 or not all(isinstance(body, str) for body in one):
            raise InputError(f"{name}: {shown(pair)}: {rule}", name=name, value=shown(pair))
        found.add(one)
    return frozenset(found)


def option_numbers(option: str, text: str, count: int, what: str) -> Array:
    """Return the numbers (count,) of an option such as ``--q=0,10,-80,0,-60,0``; `what` they are, for the message.

    Raises:
        InputError: they are not as many finite numbers.
    """
    parts = text.split(",")
    try:
        values = np.array([float(part) for part in parts])
    except ValueError:
        values = np.zeros(0)
    if len(values) != count or not np.isfinite(values).all():
        found = "" if len(parts) == count else f", not {len(parts)}"
        if foreign := re.search(r"[^\d.,+\-eE\s]", text):
            found += f"; {foreign[0]!r} is no part of a number"
        elif len(parts) > count:
            found += "; the decimal sign is a point"
        why = f"{option}={text}: must be {count} numbers separated by commas, {what}{found}"
        raise InputError(why, option=option, value=text)
    return frozen(values)
