"""Foreign modules that shadow a package of this project, such as a ``cell.py`` beside a user's program.

This module only looks at the file system, because no package can be imported before the check.
"""

from __future__ import annotations

import sys
from importlib.machinery import PathFinder
from pathlib import Path

ROOMS = ("arm", "plan", "vision", "driver", "render", "calib", "cell")
_HERE = Path(__file__).resolve().parents[1]  # the packages lie beside this one


def shadowed() -> list[str]:
    """Return one message for each package that Python does not find in its place."""
    return [problem for room in ROOMS if (problem := _problem(room))]


def _problem(room: str) -> str:
    own = _HERE / room
    spec = PathFinder.find_spec(room)
    found = None if spec is None or spec.origin is None else Path(spec.origin)
    if found is not None and found.resolve().parent == own:
        return ""
    if not (own / "__init__.py").is_file():
        return f"{own} is missing; install a465 again"
    if found is None:  # only if the path to a465 itself was removed meanwhile
        return f"{own} is not found in {sys.path}"
    shown = found.parent if found.name == "__init__.py" else found
    return f"{shown} is found instead of a465's own {room}"


def require_own_rooms() -> None:
    """Require that Python finds the packages of this project.

    Raises:
        ImportError: other modules shadow them; the message is one line, with what would help.
    """
    others = shadowed()
    if others:
        raise ImportError(
            f"{'; '.join(others)}: rename it, or start a465 in another folder and without PYTHONPATH"
        )
