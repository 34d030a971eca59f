"""Modules of other people that have a room's name and are found before it: a ``cell.py`` beside a user's own program.

Looks only at the file system: nothing of the rooms can be imported before this is known.
"""

from __future__ import annotations

import sys
from importlib.machinery import PathFinder
from pathlib import Path

ROOMS = ("arm", "plan", "vision", "driver", "render", "calib", "cell")
_HERE = Path(__file__).resolve().parents[1]  # the rooms lie beside this package


def shadowed() -> list[str]:
    """What is wrong with the rooms, each in a few words; empty if Python finds all of them where they belong."""
    return [told for room in ROOMS if (told := _told(room))]


def _told(room: str) -> str:
    own = _HERE / room
    spec = PathFinder.find_spec(room)
    found = None if spec is None or spec.origin is None else Path(spec.origin)
    if found is not None and found.resolve().parent == own:
        return ""
    if not (own / "__init__.py").is_file():
        return f"{own} is missing; install a465 again"
    if found is None:  # only where the path to a465 itself was taken away meanwhile
        return f"{own} is not found in {sys.path}"
    shown = found.parent if found.name == "__init__.py" else found
    return f"{shown} is found in place of a465's own {room}"


def require_own_rooms() -> None:
    """See that the rooms are ours.

    Raises:
        ImportError: others are found before them; in one line, with what would help.
    """
    others = shadowed()
    if others:
        raise ImportError(
            f"{'; '.join(others)}: rename it, or begin a465 in another folder and without PYTHONPATH"
        )
