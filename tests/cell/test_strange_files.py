"""Files that are no files, or are made to harm: one line, exit 2, and nothing waits or fills the memory."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from typed.command_line import ended, replace_in

ZERO = "/dev/zero: is a character device; only regular files are read"
COMMANDS = {
    "check PLAN": ("check", "/dev/zero", "scenes/task2.toml"),
    "execute PLAN": ("execute", "/dev/zero", "scenes/task2.toml"),
    "preview PLAN": ("preview", "/dev/zero", "scenes/task2.toml"),
    "export PLAN": ("export", "/dev/zero"),
    "run TASK": ("run", "/dev/zero"),
    "reach LOOK": ("reach", "scenes/task2.toml", "--look", "/dev/zero"),
    "look DETECTIONS": ("look", "--detections", "/dev/zero"),
    "look WORLD": ("look", "scenes/task1.toml", "--world", "/dev/zero"),
    "plan POSES": ("plan", "scenes/cell.toml", "/dev/zero"),
    "calibrate hand-eye": ("calibrate", "hand-eye", "/dev/zero"),
    "calibrate kinematic": ("calibrate", "kinematic", "/dev/zero"),
    "emulate FAULT": ("emulate", "--fault", "/dev/zero"),
}


def refused(*arguments: object, cwd: Path) -> str:
    """The one line of a refusal of bad input."""
    code, told = ended(*arguments, cwd=cwd)
    assert code == 2, told
    assert told.count("\n") == 1
    assert told.startswith("a465: wrong input: ")
    return told


@pytest.mark.parametrize("command", COMMANDS)
def test_a_device_is_told_in_one_line(tmp_path: Path, scenes: Path, command: str) -> None:
    assert ZERO in refused(*COMMANDS[command], cwd=scenes.parent)


def test_a_pipe_among_photographs_is_told_and_not_waited_for(scenes: Path) -> None:
    shots = scenes.parent / "shots"
    shots.mkdir()
    os.mkfifo(shots / "a.png")
    for command in (
        ("look", "scenes/task2.toml", "--images", shots),
        ("calibrate", "camera", shots, "-o", "lens.toml"),
    ):
        for number in range(2, 6):
            (shots / f"b{number}.png").touch()
        assert "a.png: is a named pipe; only regular files are read" in refused(*command, cwd=scenes.parent)


def test_a_key_of_100_000_parts_is_told_and_fills_no_memory(scenes: Path) -> None:
    replace_in(scenes / "task2.toml", "task = ", ".".join(["a"] * 100_000) + " = 1\ntask = ")
    told = refused("run", "scenes/task2.toml", cwd=scenes.parent)
    assert "has a key of more than 16 parts" in told


def test_a_long_value_is_shortened(scenes: Path) -> None:
    replace_in(scenes / "task2.toml", 'task = "', 'task = "' + "x" * 100_000)
    told = refused("run", "scenes/task2.toml", cwd=scenes.parent)
    assert "characters left out" in told
    assert len(told) < 560
