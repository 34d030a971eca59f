"""One arm on one controller: encoder counts, limits and registers, read from a unit file (``urdf/a465/<unit>.toml``).

Counts are quadrature counts (times 4). The unit of a speed register is 1/256 count per ms, that of an acceleration
register 1/256 count per ms^2 (docs/sources.md, "Registers"; the latter is assumed until measured).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from numbers import Real
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from arm.arguments import numbers, shown
from arm.controller.unit_keys import GripperValues, UnitKeys, UnitValues
from arm.errors import FileInputError, InputError
from arm.io.node import Node, Rule
from arm.io.rules import path as path_rule
from arm.io.rules import text as text_rule
from arm.io.storage import data_file, read_bytes, sha256
from arm.io.toml_reader import parse_toml
from arm.se3 import Array, frozen

Counts = npt.NDArray[np.int64]
UNITS = ("crs93", "crs97")
"""Names of the shipped units."""
SUFFIX = ".toml"  # of a unit's file
_CHOICES = f"one of {', '.join(UNITS)}, or a unit file (NAME{SUFFIX})"
_FEW, _MANY = 0.4, 3.0  # of the data sheet's range that the counts allow: less, or more, is another unit's
_SLOW = np.radians(10.0)  # rad/s; no arm is slower in all joints, and none is faster in rad/s read as deg/s
# what a log notes of its unit: the name, and of one of a user's own the file
_NOTED, _FILE = "unit", "unit_file"


@dataclass(frozen=True)
class Limits:
    """Limits of planned motion.

    Attributes:
        lower, upper: joint positions (n,), rad.
        velocity: (n,), rad/s, in both directions.
        acceleration: (n,), rad/s^2, in both directions.

    Raises:
        InputError: different lengths, a number that is not finite, a lower limit above the upper one, or a velocity or
            acceleration that is not positive.
    """

    lower: Array
    upper: Array
    velocity: Array
    acceleration: Array

    def __post_init__(self) -> None:
        n = np.size(self.lower)
        for key in ("lower", "upper", "velocity", "acceleration"):
            value = numbers(getattr(self, key))
            if value is None or value.shape != (n,) or not n:
                found = shown(getattr(self, key) if value is None else value)
                why = f"limits: {key} = {found}: must be one number per joint, ({n},) like lower"
                raise InputError(why, name=key)
            least = 0.0 if key in ("velocity", "acceleration") else -np.inf
            wrong = np.flatnonzero(~(np.isfinite(value) & (value > least)))
            if len(wrong):
                k = int(wrong[0])
                rule = "finite and above 0; a URDF may lack it" if least == 0.0 else "finite"
                why = f"limits: {key}[{k}] = {value[k]:g}: must be {rule}"
                raise InputError(why, name=key, joint=k, value=float(value[k]))
            object.__setattr__(self, key, frozen(value))
        empty = np.flatnonzero(self.lower > self.upper)
        if len(empty):
            k = int(empty[0])
            why = (
                f"limits: lower[{k}] = {self.lower[k]:g} is above upper[{k}] = {self.upper[k]:g}; must not be"
            )
            raise InputError(why, name="lower", joint=k, value=float(self.lower[k]))

    def scaled(self, speed: float) -> Limits:
        """Return the limits of motion slowed down by `speed`: velocities times speed, accelerations times speed^2.

        Raises:
            InputError: speed is not in (0, 1].
        """
        if not (isinstance(speed, Real) and 0.0 < float(speed) <= 1.0):
            why = f"speed = {shown(speed)}: must be above 0 and at most 1; it only lowers what the registers allow"
            raise InputError(why, speed=speed)
        return Limits(
            self.lower, self.upper, frozen(self.velocity * speed), frozen(self.acceleration * speed**2)
        )


class GripperAxis(GripperValues):
    """The gripper's analogue servo axis.

    Attributes:
        registers: REG* name to value.
        fitted: whether the arm carries the gripper. If not, nothing is sent to its axis.
    """

    registers: dict[str, int]
    fitted: bool = True

    def adc(self, fraction_closed: float) -> int:
        """Return the ADC position for 0 (open) to 1 (closed)."""
        return round(self.open_adc + fraction_closed * (self.closed_adc - self.open_adc))

    def fraction_closed(self, adc: float) -> float:
        """Return 0 (open) to 1 (closed) for an ADC position."""
        return (adc - self.open_adc) / (self.closed_adc - self.open_adc)


class Unit(UnitValues):
    """Parameters of one arm and its controller: the values of its file, and values derived from them.

    Attributes:
        counts_per_rad: signed, (6,).
        counts_at_zero: encoder counts at q = 0, (6,) int.
        lower, upper: position limits for planning: the tighter of encoder bounds and data sheet, minus the margin;
            (6,) rad.
        axis_registers: REG* name to (6,) int, set once at start.
        homing: groups of axes homed together, in order.
        gripper: the gripper's axis.
        digest: SHA-256 of the file.
        source: text of the file of a user's own unit; "" for a shipped one, which is known by its name.
    """

    counts_per_rad: Array
    counts_at_zero: Counts
    lower: Array
    upper: Array
    axis_registers: dict[str, tuple[int, ...]]
    homing: tuple[tuple[str, ...], ...]
    gripper: GripperAxis
    digest: str
    source: str = field(default="", repr=False)

    def counts(self, q: npt.ArrayLike) -> Counts:
        """Return the encoder counts nearest to joint positions (..., 6) in rad.

        Raises:
            InputError: another shape, or not numbers.
        """
        exact = self.counts_at_zero + self._of_each("q", q) * self.counts_per_rad
        return np.rint(exact).astype(np.int64)

    def positions(self, counts: npt.ArrayLike) -> Array:
        """Return the joint positions, rad, for encoder counts (..., 6).

        Raises:
            InputError: another shape, or not numbers.
        """
        offset = self._of_each("counts", counts) - self.counts_at_zero
        return np.asarray(offset / self.counts_per_rad, dtype=float)

    def _of_each(self, name: str, value: npt.ArrayLike) -> Array:
        """Return `value` as an array whose last axis has one number per joint."""
        array, n = numbers(value), len(self.counts_at_zero)
        if array is None or array.shape[-1:] != (n,):
            found = shown(value if array is None else array)
            why = f"{name} = {found}: must have {n} numbers, one for each joint"
            raise InputError(why, name=name, joints=n)
        return array

    def calibrated(self, joint_offsets: npt.ArrayLike) -> Unit:
        """Return the unit corrected by joint offsets (true positions minus those of the encoders), (6,) rad.

        Zeros shift by whole counts. Position limits never widen.
        """
        offsets = np.asarray(joint_offsets, dtype=float)
        if not offsets.any():
            return self
        at_zero = np.rint(self.counts_at_zero - offsets * self.counts_per_rad).astype(np.int64)
        at_zero.flags.writeable = False
        return replace(
            self,
            counts_at_zero=at_zero,
            lower=frozen(self.lower + np.maximum(offsets, 0.0)),
            upper=frozen(self.upper + np.minimum(offsets, 0.0)),
            digest=sha256({"unit": self.digest, "counts_at_zero": at_zero.tolist()}),
        )

    def beyond_limits(self, q: Array) -> str:
        """Return in words the position limit that a configuration q (6,) rad violates; "" if it violates none."""
        for joint, (value, low, high) in enumerate(zip(q, self.lower, self.upper, strict=True), start=1):
            if not low <= value <= high:
                low, high = np.degrees((low, high))
                return f"J{joint} must be from {low:.1f} to {high:.1f} deg on {self.name}"
        return ""

    def velocity(self, registers: npt.ArrayLike) -> Array:
        """Return the joint velocities, rad/s, for speed registers (6,)."""
        return np.asarray(registers, dtype=float) / 256.0 * 1e3 / np.abs(self.counts_per_rad)

    def acceleration(self, registers: npt.ArrayLike) -> Array:
        """Return the joint accelerations, rad/s^2, for acceleration registers (6,)."""
        return np.asarray(registers, dtype=float) / 256.0 * 1e6 / np.abs(self.counts_per_rad)

    def speed_register_cap(self) -> tuple[int, ...]:
        """Return the largest speed registers allowed: twice the default, but never beyond the data sheet."""
        sheet = np.floor(self.velocity_cap * np.abs(self.counts_per_rad) * 256.0 / 1e3).astype(int)
        return tuple(min(2 * r, int(s)) for r, s in zip(self.speed_registers, sheet, strict=True))

    def acceleration_register_cap(self) -> tuple[int, ...]:
        """Return the largest acceleration registers allowed: twice the default."""
        return tuple(2 * r for r in self.acceleration_registers)

    def limits(
        self,
        speed_registers: tuple[int, ...] | None = None,
        acceleration_registers: tuple[int, ...] | None = None,
    ) -> Limits:
        """Return the limits under these registers (defaults: the unit's own).

        Raises:
            InputError: not one integer per axis, or a register is below 1 or above its cap.
        """
        speed = self._registers("speed", speed_registers, self.speed_registers)
        acceleration = self._registers("acceleration", acceleration_registers, self.acceleration_registers)
        for name, values, caps in (
            ("speed", speed, self.speed_register_cap()),
            ("acceleration", acceleration, self.acceleration_register_cap()),
        ):
            for axis, value, cap in zip(self.axes, values, caps, strict=True):
                if not 1 <= value <= cap:
                    why = (
                        f"{name} register of axis {axis} = {value}: must be from 1 to {cap} on {self.name} "
                        "(twice the default, never beyond the data sheet)"
                    )
                    raise InputError(why, axis=axis, value=value, cap=cap)
        return Limits(
            self.lower, self.upper, frozen(self.velocity(speed)), frozen(self.acceleration(acceleration))
        )

    def _registers(self, name: str, given: Any, usual: tuple[int, ...]) -> tuple[int, ...]:
        if given is None:
            return usual
        values = numbers(given)
        if values is None or values.shape != (len(self.axes),) or (values != np.rint(values)).any():
            why = f"{name} registers = {shown(given)}: must be {len(self.axes)} integers, one per axis of {self.name}"
            raise InputError(why, value=shown(given))
        return tuple(int(v) for v in values)


def load_unit(name: str | Path) -> Unit:
    """Read a unit by name (``crs93``, ``crs97``) or from a file of the same format.

    Raises:
        InputError: the name is unknown, or a value in the file breaks a rule.
    """
    if isinstance(name, Path):
        if not name.exists() and name.stem in UNITS:
            raise FileInputError(
                name, "", None, "there is no such unit file", f"{name.stem} is shipped: give {name.stem}"
            )
        unit = _unit_of(Node.of_toml(name, "unit"), sha256(read_bytes(name, "TOML")))
        if unit.digest in {load_unit(known).digest for known in UNITS}:
            return unit
        if unit.name in UNITS:
            raise Node.of_toml(name).error_at(
                "name",
                "is that of a shipped unit with other values",
                f"give this unit its own, such as {unit.name}-hall3, by which plans, calibrations and logs know it",
            )
        return replace(unit, source=read_bytes(name, "TOML").decode("utf-8-sig"))
    if name not in UNITS:
        why = f"unit = {name!r}: must be {_CHOICES}"
        raise InputError(why, value=name, choices=list(UNITS))
    path = data_file(f"urdf/a465/{name}{SUFFIX}")
    return _unit_of(Node.of_toml(path), sha256(read_bytes(path, "TOML")))


def unit_called(text: str) -> Unit:
    """Read the unit that a command line names: a shipped one, or a unit file.

    Raises:
        InputError: see `load_unit`.
    """
    return load_unit(Path(text) if text.endswith(SUFFIX) else text)


def unit_rule() -> Rule[Unit]:
    """The unit that a file names: a shipped one, or a unit file relative to the file that names it."""

    def read(node: Node) -> Unit:
        if isinstance(node.value, str) and node.value.endswith(SUFFIX):
            return load_unit(path_rule().read(node))
        try:
            return load_unit(text_rule(*UNITS).read(node))
        except FileInputError as error:
            raise node.error(f"must be {_CHOICES}", str(error.data["help"])) from error

    return Rule(_CHOICES, read)


def unit_note(unit: Unit) -> dict[str, str]:
    """Return what a log notes of its unit, for `noted_unit`: of one of a user's own the file, too."""
    return {_NOTED: unit.name} | ({_FILE: unit.source} if unit.source else {})


def noted_unit(noted: Mapping[str, Any]) -> Unit | None:
    """Return the unit that a log notes; None if it notes none that is known.

    Raises:
        FileInputError: a value of the noted file breaks a rule.
    """
    name, text = noted.get(_NOTED), noted.get(_FILE)
    if isinstance(text, str):
        path = Path(f"{name}{SUFFIX}")
        unit = _unit_of(Node(path, "", parse_toml(path, text)), sha256(text))
        return replace(unit, source=text)
    return load_unit(name) if name in UNITS else None


def _unit_of(root: Node, digest: str) -> Unit:
    """Return the unit of a file's content."""
    keys = UnitKeys.read(root)
    if not np.all(np.abs(keys.direction) == 1):
        raise root.error_at("encoder.direction", "must be six numbers, each 1 or -1")
    if len({*keys.axes, keys.axis}) < len(keys.axes) + 1:
        raise root.error_at("axes", f"must be six different letters, without {keys.axis}, the gripper's axis")
    if keys.open_adc == keys.closed_adc:
        raise root.error_at(
            "gripper.closed_adc", "must differ from open_adc: the jaws' position would be unknown"
        )
    groups = tuple(map(tuple, keys.homing))
    if sorted(axis for group in groups for axis in group) != sorted(keys.axes):
        raise root.error_at("homing.sequence", "must name every axis once, in groups")
    at_zero = np.array(keys.at_zero, dtype=np.int64)
    at_zero.flags.writeable = False
    counts_per_rad = frozen(keys.per_turn * 4.0 * keys.gear * keys.direction / (2.0 * np.pi))
    encoder_lower, encoder_upper = (np.array([keys.lower, keys.upper]) - at_zero) / counts_per_rad
    if keys.sheet.max() < np.radians(2.0 * np.pi):  # in deg, what no arm exceeds in rad
        raise root.error_at(
            "limits.data_sheet_deg", "must not be below 6.28 deg for every joint", "is it in rad?"
        )
    lower = frozen(np.maximum(encoder_lower, -keys.sheet) + keys.margin)
    upper = frozen(np.minimum(encoder_upper, keys.sheet) - keys.margin)
    if not np.all(lower < upper):
        in_deg = max(np.abs(keys.lower).max(), np.abs(keys.upper).max()) <= 360
        raise root.error_at(
            "limits.lower_counts",
            "with upper_counts must not leave a joint without range; check direction",
            "are these degrees? counts belong here" if in_deg else "",
        )
    share = np.abs(encoder_upper - encoder_lower) / (2.0 * keys.sheet)
    if (share < _FEW).all() or (share > _MANY).all():
        least, most = np.rint(100.0 * share.min()), np.rint(100.0 * share.max())
        rule = f"with gear and limits gives joints {least:.0f} to {most:.0f} % of the range of limits.data_sheet_deg"
        help = "are these 4 times too many? Lines before quadrature belong here" if share.max() < _FEW else ""
        raise root.error_at(
            "encoder.counts_per_turn", rule, help or "are limits, turns and gear of one unit?"
        )
    sheet = np.floor(keys.velocity_cap * np.abs(counts_per_rad) * 256.0 / 1e3)
    for axis, speed, most in zip(keys.axes, keys.speed_registers, sheet, strict=True):
        if speed > most:
            rule = f"axis {axis} must be at most {most:.0f}: limits.data_sheet_deg_s allows no more"
            in_rad = "is limits.data_sheet_deg_s in rad/s?" if keys.velocity_cap.max() < _SLOW else ""
            raise root.error_at("registers.speed", rule, in_rad)
    if not ((lower <= keys.soft_home) & (keys.soft_home <= upper)).all():
        k = int(np.flatnonzero((keys.soft_home < lower) | (keys.soft_home > upper))[0])
        least, most = np.degrees([lower[k], upper[k]])
        rule = f"J{k + 1} must be from {least:.1f} to {most:.1f} deg, its limits"
        raise root.error_at("homing.soft_home_deg", rule)
    registers = {name: getattr(keys, name) for name in UnitKeys.declared() if "REG" in name}
    return Unit(
        **keys.values_of(UnitValues),
        counts_per_rad=counts_per_rad,
        counts_at_zero=at_zero,
        lower=lower,
        upper=upper,
        axis_registers={name: value for name, value in registers.items() if name.startswith("REG")},
        homing=groups,
        gripper=GripperAxis(
            **keys.values_of(GripperValues),
            registers={"REGS1": keys.current_channel}
            | {n.removeprefix("gripper_"): v for n, v in registers.items() if n.startswith("gripper_")},
        ),
        digest=digest,
    )
