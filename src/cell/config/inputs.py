"""Values of a task and cell file by key. A plan stores them, so that a later change can be named.

Values are compared, not texts: comments, order and number formats make no difference.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from arm.board import PLATE, SECOND_MARKER, Board
from arm.io.storage import canonical_json, sha256

Inputs = Mapping[str, Any]
# Keys that do not affect a plan, or that are compared separately (unit, camera, registers).
LEFT_OUT = (
    *("unit", "port", "camera", "calibration", "background"),
    *("tool.least_certain_mm", "tool.least_certain_height_mm"),
    *("boards.files", "boards.tilts_deg", "boards.made_within_mm"),
    *("look.photographs", "look.camera_moved_mm", "look.basler.", "look.video."),
    *("look.least_certain_mm", "look.least_certain_height_mm", "look.least_certain_deg"),
    *("motion.speed", "motion.speed_registers", "motion.acceleration_registers"),
)
_SHOWN = 4


def config_inputs(
    values: Mapping[str, Any], left_out: Sequence[str] = (), boards: Sequence[Board] = ()
) -> Inputs:
    """Flatten a TOML file to dotted keys.

    Args:
        values: content of the file.
        left_out: keys to omit; one that ends with a dot omits all keys below it.
        boards: boards, which have their own files; added as hashes of their content.

    Returns:
        Dotted key to value. Tables of an array are keyed by their `name`.
    """
    flat = {
        key: value
        for key, value in sorted(_flat("", values))
        if not any(key == out or (out.endswith(".") and key.startswith(out)) for out in left_out)
    }
    for board in boards:
        content: list[Any] = [list(board.marker_ids), board.holes.tolist(), board.marker_size]
        if (board.plate, board.second_marker) != (PLATE, SECOND_MARKER):
            content += [list(board.second_marker), list(board.plate.size), list(board.plate.centre)]
        flat[f"board {board.name}"] = sha256(canonical_json(content))[:12]
    return flat


def _flat(prefix: str, value: Any) -> list[tuple[str, Any]]:
    if isinstance(value, Mapping):
        inside = [(f"{prefix}.{key}" if prefix else key, inner) for key, inner in value.items()]
    elif isinstance(value, list) and value and all(isinstance(v, Mapping) for v in value):
        inside = [(f"{prefix}[{v.get('name', i)}]", v) for i, v in enumerate(value)]
    else:
        return [(prefix, _plain(value))]
    return [pair for name, inner in inside for pair in _flat(name, inner)]


def _plain(value: Any) -> Any:
    """Convert integers to floats, so that 15 equals 15.0."""
    if isinstance(value, list):
        return [_plain(v) for v in value]
    return float(value) if isinstance(value, int) and not isinstance(value, bool) else value


def changes(then: Inputs, now: Inputs) -> list[str]:
    """Describe the differences: each changed key with both values, added and removed tables by their name."""
    found: dict[str, None] = {}
    for key in sorted(then.keys() | now.keys()):
        if key in then and key in now:
            if then[key] != now[key]:
                found[f"{key} {_shown(then[key])}, now {_shown(now[key])}"] = None
            continue
        table, inside, _ = key.partition("]")
        whole = table + inside if inside else key
        others = now if key in then else then
        if inside and not any(other.startswith(whole) for other in others):
            found[f"{whole} is {'gone' if key in then else 'new'}"] = None
        else:
            found[f"{key} {_shown(then[key])}, now not given" if key in then else f"{key} is new"] = None
    return list(found)


def shortened(words: Sequence[str]) -> str:
    """Join the first few, and append how many more there are."""
    more = len(words) - _SHOWN
    return "; ".join(words[:_SHOWN]) + (f"; and {more} more" if more > 0 else "")


def _shown(value: Any) -> str:
    if isinstance(value, list):
        return f"[{', '.join(map(_shown, value))}]"
    return f"{value:g}" if isinstance(value, float) else str(value)
