"""What may be meant by the name of a file that is not there."""

from __future__ import annotations

import os
import re
from contextlib import suppress
from difflib import get_close_matches
from itertools import islice
from pathlib import Path

_MOST_LISTED = 1000  # names of a folder among which a similar one is searched
_ALIKE = 0.8  # of two names, by `difflib`, before one is proposed for the other


def missing(path: Path) -> str:
    """Say what may be meant by the name of a file that is not there; "" if nothing shows it."""
    name = str(path)
    if help := _unexpanded(name):
        return help
    if "\\" in name and (slashed := Path(name.replace("\\", "/"))).exists():
        return f"with / for \\ it is {slashed}"
    below = (Path(*path.parts[k:]) for k in range(1, len(path.parts)))
    if not path.is_absolute() and (here := next((one for one in below if one.exists()), None)):
        return f"from this folder it is {here}"
    return f"is it {near}?" if (near := _near(path)) else _no_folder(path)


def no_file(path: Path, of: Path) -> tuple[str, str]:
    """Return the rule that a name in a file breaks by which there is no file, and what would help.

    Args:
        path: the name, already joined to the folder of the file that has it.
        of: the file that has it.
    """
    if path.is_dir():
        return f"names a folder, must name a file: {path}", ""
    named = os.path.relpath(path, of.parent)
    relative = f"names are relative to the folder of {of.name}: "
    there = Path(os.path.realpath(of))
    is_linked = there.parent != Path(os.path.realpath(of.parent))
    if path.name != named and (of.parent / path.name).is_file():
        help = f'{relative}"{path.name}" is there'
    elif named and not os.path.isabs(named) and Path(named).is_file():  # written from the working folder
        help = f'{relative}"{os.path.relpath(named, of.parent)}"'
    elif is_linked and (there.parent / named).is_file():
        help = f"a link leads to {there}, which has it beside it: give that file"
    elif near := _near(path):
        help = f'is it "{os.path.relpath(near, of.parent)}"?'
    else:
        help = _unexpanded(named) or _no_folder(path)
    return f"names a file that does not exist: {path}", help


def _unexpanded(name: str) -> str:
    """Say what of a name only a shell or a browser understands; "" if nothing."""
    if re.match(r"(?:package|model):/", name):
        return "packages of ROS are not searched; give the file's path"
    if re.match(r"(?:https?|ftp|file):/", name):
        return "it is an address; download the file, and give its path"
    if name.startswith("~") or "$" in name:
        return "~ and $NAME stand for nothing within quotes or in a file; write the path out"
    return "no name matches the pattern" if "*" in name or "?" in name else ""


def _near(path: Path) -> Path | None:
    """Return what is there under nearly this name, or under this name in a folder beside it."""
    with suppress(OSError):
        names = [one.name for one in islice(path.parent.iterdir(), _MOST_LISTED)]
        same = [one for one in names if path.name.lower() in (one.lower(), Path(one).stem.lower())]
        if alike := same or get_close_matches(path.name, names, 1, _ALIKE):
            return path.with_name(alike[0])
        return next(path.parent.glob(f"*/{path.name}"), None)
    return None


def _no_folder(path: Path) -> str:
    """Name the folder that is not there; "" if it is there."""
    gone = [folder for folder in path.parents if not folder.exists()]
    return f"there is no folder {gone[-1]}" if gone else ""
