"""What of a user's own unit file is rather in another unit, order or sign than that of the shipped units."""

from __future__ import annotations

import tomllib
from collections.abc import Iterator
from typing import Any

import numpy as np

from arm.controller.unit import SUFFIX, UNITS, Unit
from arm.io.storage import data_file
from arm.io.toml_reader import read_toml
from arm.se3 import Array

_FACTOR = 3.5  # between values of units of one model, in encoder and limits; lines are counts / 4
_FACTOR_TUNED = 8.0  # of registers, which people tune
_FREE = {"encoder.counts_at_zero", "limits.margin_deg", "limits.rest_tolerance_counts"}
_FREE |= {"gripper.adc_channel", "gripper.current_channel", "gripper.i", "registers.idle_release_s"}


def unit_doubts(unit: Unit) -> tuple[str, ...]:
    """Say of each value of a user's own unit, of a model that is shipped too, that it may be meant otherwise."""
    if not unit.source:
        return ()
    own = tomllib.loads(unit.source)
    shipped = {name: read_toml(data_file(f"urdf/a465/{name}{SUFFIX}")) for name in UNITS}
    if own["model"] not in {one["model"] for one in shipped.values()}:
        return ()
    others = {name: dict(_numbers(one)) for name, one in shipped.items()}
    found = []
    for key, value in _numbers(own):
        usual = {
            name: one[key] for name, one in others.items() if key in one and one[key].shape == value.shape
        }
        if doubt := _doubt(key, value, usual):
            stated = ", ".join(f"{v:.6g}" for v in value.tolist())
            stated = f"[{stated}]" if len(value) > 1 else stated
            found.append(f"unit {unit.name}: {key} = {stated}: {doubt}")
    return tuple(found)


def _numbers(file: dict[str, Any]) -> Iterator[tuple[str, Array]]:
    """Yield each number and list of numbers of the tables of a unit file, with its key."""
    for table, values in file.items():
        for name, value in values.items() if isinstance(values, dict) else ():
            items = value if isinstance(value, list) else [value]
            if f"{table}.{name}" not in _FREE and all(isinstance(v, int | float) for v in items):
                yield f"{table}.{name}", np.array(items, dtype=float)


def _doubt(key: str, value: Array, usual: dict[str, Array]) -> str:
    """Say how a value differs from those of shipped units, by name, as people mistake it; "" if it does not."""
    if any((value == other).all() for other in usual.values()):
        return ""
    most = _FACTOR if key.startswith(("encoder.", "limits.")) else _FACTOR_TUNED
    ratios = []
    for name, other in usual.items():
        has = f"{name} has {', '.join(f'{v:.6g}' for v in other.tolist())}"
        if (np.abs(value) == np.abs(other)).all():
            return f"differs by signs alone: {has}"
        if len(value) > 1 and (np.sort(value) == np.sort(other)).all():
            return f"has the numbers of {name} in another order: {has}"
        told = other != 0.0
        ratios.append(float(np.median(np.abs(value[told] / other[told]))) if told.any() else 1.0)
    if not ratios or any(1.0 / most < ratio < most for ratio in ratios):
        return ""
    return f"is {ratios[-1]:.2g} times that of a shipped unit; is it in another unit of measure? {has}"
