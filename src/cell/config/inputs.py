"""What a task and cell file say, key by key: a plan keeps it, so that a change can be named.

Values are compared, not texts: comments, order and the way of writing a number make no difference.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from arm.board import Board
from arm.io.storage import canonical_json, sha256

Inputs = Mapping[str, Any]
# Keys that do not make a plan another one, or that are compared on their own (unit, camera, registers).
LEFT_OUT = (
    "unit",
    "camera",
    "calibration",
    "boards.files",
    "boards.tilts_deg",
    "boards.made_within_mm",
    "look.photographs",
    "look.least_certain_mm",
    "look.least_certain_height_mm",
    "look.least_certain_deg",
    "look.basler.",
    "motion.speed",
    "motion.speed_registers",
    "motion.acceleration_registers",
)
_SHOWN = 4


def inputs_of(
    values: Mapping[str, Any], left_out: Sequence[str] = (), boards: Sequence[Board] = ()
) -> Inputs:
    """Dotted key to value, all of a TOML file but `left_out` (a key, or all under one that ends with a dot).

    Tables of an array go by their `name`. Boards, which are files of their own, are added as hashes of what they say.
    """
    flat = {
        key: value
        for key, value in sorted(_flat("", values))
        if not any(key == out or (out.endswith(".") and key.startswith(out)) for out in left_out)
    }
    for board in boards:
        said = [list(board.marker_ids), board.holes.tolist(), board.marker_size]
        flat[f"board {board.name}"] = sha256(canonical_json(said))[:12]
    return flat


def _flat(prefix: str, value: Any) -> list[tuple[str, Any]]:
    if isinstance(value, Mapping):
        return [
            pair
            for key, inner in value.items()
            for pair in _flat(f"{prefix}.{key}" if prefix else key, inner)
        ]
    if isinstance(value, list) and value and all(isinstance(v, Mapping) for v in value):
        named = [(v.get("name", i), v) for i, v in enumerate(value)]
        return [pair for name, inner in named for pair in _flat(f"{prefix}[{name}]", inner)]
    return [(prefix, _plain(value))]


def _plain(value: Any) -> Any:
    """15 and 15.0 are the same."""
    if isinstance(value, list):
        return [_plain(v) for v in value]
    return float(value) if isinstance(value, int) and not isinstance(value, bool) else value


def changes(then: Inputs, now: Inputs) -> list[str]:
    """What differs, in words: each key with the value of then and of now; tables that came or went by their name."""
    told: dict[str, None] = {}
    for key in sorted(then.keys() | now.keys()):
        if key in then and key in now:
            if then[key] != now[key]:
                told[f"{key} {_shown(then[key])}, now {_shown(now[key])}"] = None
            continue
        table, inside, _ = key.partition("]")
        whole = table + inside if inside else key
        others = now if key in then else then
        if inside and not any(other.startswith(whole) for other in others):
            told[f"{whole} is {'gone' if key in then else 'new'}"] = None
        else:
            told[f"{key} {_shown(then[key])}, now not given" if key in then else f"{key} is new"] = None
    return list(told)


def shortened(words: Sequence[str]) -> str:
    """The first few, and how many more."""
    more = len(words) - _SHOWN
    return "; ".join(words[:_SHOWN]) + (f"; and {more} more" if more > 0 else "")


def _shown(value: Any) -> str:
    if isinstance(value, list):
        return f"[{', '.join(map(_shown, value))}]"
    return f"{value:g}" if isinstance(value, float) else str(value)
