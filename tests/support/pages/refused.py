"""Requests that are refused, each for another reason, with what shows them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from arm.io.storage import data_file
from plans.other_arms import scara_files
from typed.command_line import replace_in

_POST = """[[bodies]]
name = "post"
size_mm = [40, 40, 300]
centre_mm = [0, 60, 150]

[[bodies]]
file = "board.toml"
"""


@dataclass(frozen=True)
class Refusal:
    """A command that is refused.

    Attributes:
        words: the command without the page.
        file: the file that it plans.
        pair: the bodies that it names.
        place: the place that it names.
    """

    words: tuple[str, ...]
    file: Path
    pair: tuple[str, ...] = ()
    place: str = ""


def arm_in_a_post(folder: Path) -> Refusal:
    """An arm file whose post stands at a pose of the list."""
    arm = scara_files(folder)
    replace_in(arm, "centre_mm = [420, 20, 110]", "centre_mm = [380, -200, 110]")
    words = ("plan", str(arm), str(folder / "poses.json"), "--no-advice")
    return Refusal(words, arm, ("cup", "post"))


def arm_out_of_reach(folder: Path) -> Refusal:
    """A pose of a list 159 mm beyond what the arm reaches."""
    arm, poses = scara_files(folder), folder / "poses.json"
    replace_in(poses, "[1, 0, 0, 0.38], [0, -1, 0, 0.2]", "[1, 0, 0, 0.68], [0, -1, 0, 0.2]")
    return Refusal(("plan", str(arm), str(poses), "--no-advice"), arm, place="leave")


def program_beside_a_post(folder: Path) -> Refusal:
    """The hoop along wire D, with a post beside its foot."""
    return _program(folder, '[[bodies]]\nfile = "board.toml"\n', _POST, ("ring 1", "post"))


def program_out_of_reach(folder: Path) -> Refusal:
    """The hoop along wire D, 300 mm too far away."""
    return _program(folder, "origin_mm = [460, 0, 33]", "origin_mm = [860, 0, 33]", (), "wire D")


def _program(folder: Path, old: str, new: str, pair: tuple[str, ...], place: str = "") -> Refusal:
    shipped = data_file("scenes/hoop/d.toml").parent
    text = (shipped / "d.toml").read_text()
    for name in ("cell.toml", "board.toml", "wires/d.toml"):
        text = text.replace(f'"{name}"', f'"{shipped / name}"')
    file = folder / "d.toml"
    file.write_text(text)
    old, new = (part.replace('"board.toml"', f'"{shipped / "board.toml"}"') for part in (old, new))
    replace_in(file, old, new)
    return Refusal(("plan", str(file), "--no-advice"), file, pair, place)
