"""Rules for the values of files. A value in mm, us, mm/s, N/mm, deg or deg/s is converted to SI units and rad."""

from __future__ import annotations

import difflib
import math
import unicodedata
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from arm.errors import A465Error
from arm.io.node import Node, Rule
from arm.io.slips.names import no_file
from arm.io.slips.ports import port_fault
from arm.io.slips.values import as_text, number_of, other_count
from arm.numerics.products import mul, norm
from arm.numerics.units import unit_meant
from arm.se3 import Array, frozen, orthonormalised

T = TypeVar("T")
LARGEST = 1e9  # of any number in a file; lengths, angles, pixels and counts are smaller
_LEAST_MM = 0.5  # from a flange to a tool that is not in it; a tool in m, read as mm, is nearer
_DECIMALS, _ROUNDED = 4, 1e-12  # no multiple of 5 deg in rad has fewer; of conversions, rad
_OFF_AXIS = 2e-3  # m from the arm's axis, about which nothing stands; a place in m, read as mm, is nearer
SLACK, ROUNDING = 1e-6, 1e-9  # of correlations: as of a matrix typed with seven digits; of their eigenvalues
_SI: dict[str, Callable[[Any], Any]] = {
    "mm": lambda v: v / 1e3,
    "mm/s": lambda v: v / 1e3,
    "s/mm": lambda v: v * 1e3,
    "N/mm": lambda v: v * 1e3,
    "us": lambda v: v / 1e6,
    "deg": np.radians,
    "deg/s": np.radians,
}
_UNREADABLE = {
    "Cc": "a control character",
    "Cs": "half a surrogate pair",
    "Zl": "a line end",
    "Zp": "a line end",
}


def rule_of(
    words: str,
    good: Callable[[Any], object],
    into: Callable[[Any], T],
    help: Callable[[Any], str] | None = None,
) -> Rule[T]:
    """Return a rule that accepts values for which `good` is true; `into` converts them, `help` says what was meant."""

    def read(node: Node) -> T:
        if not good(node.value):
            raise node.error(f"must be {words}", (help or _unquoted)(node.value))
        return into(node.value)

    def _unquoted(value: Any) -> str:
        """Say that a text would be right as a number."""
        is_number_as_text = (
            isinstance(value, str) and bool(unquoted := number_of(value)) and good(unquoted[0])
        )
        return f"a number stands without quotation marks: {value.strip()}" if is_number_as_text else ""

    return Rule(words, read)


def same(value: Any) -> Any:
    """Return the value itself."""
    return value


def is_whole(value: object, low: int = -(2**31), high: int = 2**31 - 1) -> bool:
    """Whether a value is an integer from `low` to `high`; true and false are not."""
    return isinstance(value, int) and not isinstance(value, bool) and low <= value <= high


def is_number(value: object) -> bool:
    """Whether a value is a number; true and false are not."""
    return isinstance(value, int | float) and not isinstance(value, bool)


def number(unit: str = "", low: float = -LARGEST, high: float = LARGEST) -> Rule[float]:
    """A number in `unit` from `low` to `high`."""
    array = numbers((), unit, low, high)
    return Rule(array.words, lambda node: float(array.read(node)))


def numbers(
    length: int | tuple[int | None, ...] | None,
    unit: str = "",
    low: float = -LARGEST,
    high: float = LARGEST,
    gaps: bool = False,
) -> Rule[Array]:
    """Numbers in `unit` from `low` to `high`, as a read-only array.

    Args:
        length: of the list, or of all axes; None for any length but 0.
        unit: of the numbers, for the words and the conversion.
        low, high: range.
        gaps: whether null may replace a number; it becomes NaN.
    """
    shape = length if isinstance(length, tuple) else (length,)
    ranged = low > -LARGEST or high < LARGEST
    rows = "".join(f"{'' if n is None else f'{n} '}rows of " for n in shape[:-1])
    count = "a number" if not shape else "numbers" if shape[-1] is None else f"{shape[-1]} numbers"
    if not ranged:
        count = count.replace("number", "finite number")
    words = f"{rows}{count}" + (f" in {unit}" if unit else "") + (", or null" if gaps else "")
    words += f" from {low:g} to {high:g}" if ranged else ""

    def read(node: Node) -> Array:
        array = _array(node.value)
        fits = array.ndim == len(shape) and all(
            n == m or (m is None and n > 0) for n, m in zip(array.shape, shape, strict=True)
        )
        bad = ~((array >= low) & (array <= high)) if ranged else np.isinf(array)
        if not fits or (bad & ~np.isnan(array)).any() or (np.isnan(array).any() and not gaps):
            help = as_text(node.value) or (other_count(node.value, shape[-1]) if len(shape) == 1 else "")
            raise node.error(f"must be {words}", unit_meant(array, unit, low, high) if fits else help)
        for place in np.argwhere(np.abs(array) > LARGEST):
            raise node.at(place).error(f"must be from {-LARGEST:g} to {LARGEST:g}")
        return frozen(_SI.get(unit, same)(array))

    return Rule(words, read)


def triple(unit: str, low: float, high: float) -> Rule[tuple[float, float, float]]:
    """Three numbers in `unit` from `low` to `high`, such as the sizes of a box."""
    array = numbers(3, unit, low, high)

    def read(node: Node) -> tuple[float, float, float]:
        x, y, z = array.read(node).tolist()
        return x, y, z

    return Rule(array.words, read)


def _array(value: object) -> Array:
    """Return the numbers, NaN for null; an empty array if any value is neither."""
    try:
        raw = np.array(value, dtype=object)
        return np.array([_float(v) for v in raw.ravel()]).reshape(raw.shape)
    except (TypeError, ValueError):  # ValueError: rows of different lengths
        return np.zeros((0,) * 9)


def _float(value: object) -> float:
    """Return a number, NaN for null.

    Raises:
        TypeError: the value is neither.
    """
    if value is None:
        return math.nan
    if not isinstance(value, int | float) or isinstance(value, bool):
        raise TypeError(value)
    try:
        return math.inf if math.isnan(value) else float(value)
    except OverflowError:  # an integer of more than 308 digits
        return 2.0 * LARGEST if value > 0 else -2.0 * LARGEST


def rigid() -> Rule[Array]:
    """A rigid transform, 4x4; one with few digits is orthonormalised, an exact one is kept to the bit."""
    matrix = numbers((4, 4))

    def read(node: Node) -> Array:
        T = matrix.read(node)
        exact = np.abs(mul(T[:3, :3].T, T[:3, :3]) - np.eye(3)).max() <= 1e-12
        if exact and np.linalg.det(T[:3, :3]) > 0.0 and np.array_equal(T[3], (0.0, 0.0, 0.0, 1.0)):
            return T
        try:
            return orthonormalised(T)
        except A465Error as error:
            raise node.error(str(error)) from error

    return Rule(matrix.words, read)


def covariance_matrix(count: int) -> Rule[Array]:
    """A covariance, (count, count); limits are relative to the standard deviations, because rows differ in unit."""
    matrix = numbers((count, count))
    words = f"a covariance: {matrix.words}, symmetric, without negative variances"

    def read(node: Node) -> Array:
        C = matrix.read(node)
        scale = _scale(C)
        correlations = C / np.where(scale > 0.0, scale, 1.0)
        bounded = (np.abs(C) <= (1.0 + SLACK) * scale).all()  # also refuses a variance below 0
        symmetric = np.abs(correlations - correlations.T).max() <= SLACK
        if not (bounded and symmetric and np.linalg.eigvalsh(correlations)[0] >= -ROUNDING):
            raise node.error(f"must be {words}")
        return C

    return Rule(words, read)


def exceeds(part: Array, whole: Array) -> bool:
    """Whether a covariance is larger than another one, of the same shape and units, in any direction (by 1e-6)."""
    scale = _scale(whole)
    left = ((1.0 + SLACK) * whole - part) / np.where(scale > 0.0, scale, 1.0)
    return bool(np.linalg.eigvalsh(left)[0] < -ROUNDING)


def _scale(C: Array) -> Array:
    """Products of the standard deviations of rows and columns; 0 for a variance that is not above 0."""
    std = np.sqrt(np.maximum(np.diag(C), 0.0))
    return np.asarray(std[:, None] * std)


def integer(low: int, high: int) -> Rule[int]:
    """A whole number from `low` to `high`."""
    return rule_of(f"a whole number from {low} to {high}", lambda v: is_whole(v, low, high), int, as_text)


def integers(count: int, low: int, high: int, what: str = "") -> Rule[tuple[int, ...]]:
    """`count` whole numbers, each from `low` to `high`; `what` they are, for messages."""
    return rule_of(
        f"{what + ': ' if what else ''}{count} whole numbers from {low} to {high}",
        lambda v: isinstance(v, list) and len(v) == count and all(is_whole(one, low, high) for one in v),
        tuple,
        lambda v: as_text(v) or other_count(v, count),
    )


def flag() -> Rule[bool]:
    """True or false."""
    return rule_of("true or false", lambda v: isinstance(v, bool), bool)


def text(*choices: str) -> Rule[str]:
    """A string, one of `choices` if any are given."""
    words = f"one of {', '.join(choices)}" if choices else "a string"

    def read(node: Node) -> str:
        if isinstance(node.value, str) and (node.value in choices or not choices):
            return node.value
        given = str(node.value).strip()
        alike = [choice for choice in choices if choice.lower() == given.lower()]
        guess = alike or difflib.get_close_matches(given, choices, n=1)
        raise node.error(f"must be {words}", f"did you mean {guess[0]!r}?" if guess else "")

    return Rule(words, read)


def line(*choices: str) -> Rule[str]:
    """A string of one line, one of `choices` if any are given."""
    any_text = text(*choices)

    def read(node: Node) -> str:
        for at, character in enumerate(any_text.read(node)):
            if (what := _UNREADABLE.get(unicodedata.category(character))) is not None:
                raise node.error(f"must be a string of one line; character {at} is {what}")
        return str(node.value)

    return Rule(any_text.words, read)


def standing(size: int, least: float, most: float) -> Rule[Array]:
    """The place in mm of what stands around the arm, read in m. A place in metres, read as mm, is told: it is nearly on
    the arm's axis, where nothing stands; exactly on it is allowed."""
    plain = numbers(size, "mm", least, most)

    def read(node: Node) -> Array:
        found = plain.read(node)
        if 0.0 < np.abs(found[:2]).max() < _OFF_AXIS:
            rule = (
                f"must be {1e3 * _OFF_AXIS:g} mm or more from the arm's axis along x or y, or exactly on it"
            )
            raise node.error(rule, "is it in metres?")
        return found

    return Rule(plain.words, read)


def carried(most: float) -> Rule[Array]:
    """A place in mm in the frame that carries it, such as a tool's on the flange, read in m: in its origin, or not too
    near to it to be meant. One in metres, read as mm, is told."""
    plain = numbers(3, "mm", -most, most)

    def read(node: Node) -> Array:
        found = plain.read(node)
        if 0.0 < norm(found) < _LEAST_MM / 1e3:
            raise node.error(f"must be [0, 0, 0], or {_LEAST_MM:g} mm or more from there", "is it in metres?")
        return found

    return Rule(plain.words, read)


def _require_not_rad(node: Node, found: Array) -> None:
    """Refuse angles, read in rad from deg, of which one has all digits of a multiple of 5 deg in rad, within a turn.

    Numbers with fewer than `_DECIMALS` decimals, as a person types degrees, have too few to tell.
    """
    typed = np.degrees(found)
    meant = np.radians(5.0) * np.rint(typed / np.radians(5.0))  # if they are in rad
    digits = [len(repr(one).partition(".")[2]) for one in np.ravel(node.value).astype(float).tolist()]
    decimals = np.array(digits).reshape(typed.shape)
    is_alike = np.abs(typed - meant) < 0.51 * 10.0**-decimals + _ROUNDED
    within = (meant != 0.0) & (np.abs(typed) <= 2.0 * np.pi + _ROUNDED)
    if np.any(within & is_alike & (decimals >= _DECIMALS)):
        in_deg = ", ".join(f"{v:.6g}" for v in np.degrees(typed).ravel().tolist())
        help = f"in deg: [{in_deg}]" if typed.ndim else f"in deg: {in_deg}"
        raise node.error("must be in deg, and has a multiple of 5 deg in rad", help)


def turns(*size: int) -> Rule[Array]:
    """Angles in deg that a person wrote, from -360 to 360, read in rad. Multiples of 5 deg that are in rad, such as
    0.1745 and 1.5708, are told: no angle in deg has these digits."""
    plain = numbers(size, "deg", -360, 360)

    def read(node: Node) -> Array:
        found = plain.read(node)
        _require_not_rad(node, found)
        return found

    return Rule(plain.words, read)


def turn() -> Rule[float]:
    """An angle in deg, as one of `turns`."""
    angle = turns()
    return Rule(angle.words, lambda node: float(angle.read(node)))


def zero_or(least: float, most: float) -> Rule[float]:
    """A length in mm that is 0 (none) or not too small to be meant, read in m. One in metres, read as mm, is told."""
    plain = number("mm", 0.0, most)

    def read(node: Node) -> float:
        found = plain.read(node)
        if 0.0 < node.value < least:
            raise node.error(f"must be 0, or from {least:g} to {most:g} mm", "is it in metres?")
        return found

    return Rule(plain.words, read)


def path(exists: bool = True) -> Rule[Path]:
    """The path of a file, relative to the file that names it; `exists`: the file must exist."""

    def read(node: Node) -> Path:
        named = text().read(node)
        found = node.file.parent / named
        try:
            is_there = found.is_file()
        except OSError as error:  # the name is too long, or a folder may not be read
            raise node.error(f"names a file that cannot be read: {error.strerror}") from error
        if exists and not is_there:
            raise node.error(*no_file(found, node.file)) from FileNotFoundError(found)
        return found

    return Rule("a string", read)


def port() -> Rule[str]:
    """The name of a serial port: a device, relative to the file that names it, or a URL of a socket."""

    def read(node: Node) -> str:
        url = line().read(node)
        if fault := port_fault(url):
            raise node.error(fault)
        return url if "://" in url else str(node.file.parent / url)

    return Rule("a string", read)


def table() -> Rule[dict[str, Any]]:
    """A table with any keys."""
    return rule_of("a table", lambda v: isinstance(v, dict), dict)


def tables(read_one: Callable[[Node], T], *declared: Any) -> Rule[tuple[T, ...]]:
    """An array of tables, each read by `read_one`; `declared` are the classes that declare their keys."""

    def read(node: Node) -> tuple[T, ...]:
        if not isinstance(node.value, list) or not all(isinstance(v, dict) for v in node.value):
            single = isinstance(node.value, dict) and node.file.suffix == ".toml" and "[" not in node.key
            raise node.error(
                "must be an array of tables", f"write [[{node.key}]], not [{node.key}]" if single else ""
            )
        return tuple(read_one(one) for one in node.items())

    return Rule("an array of tables", read, declared)
