"""A part that is taken from the air is told; one on the table, on another part or on a body of the file is not."""

from __future__ import annotations

from pathlib import Path

import pytest

from cell.program.doubts.taken import taken_from_air
from cell.program.program_file import read_program
from programs.pallets import pallet

TAKE = "at_mm = [60, 230, 18]"
TRAY = "[[bodies]]\nname = 'tray'\nsize_mm = [80, 80, 18]\ncentre_mm = [60, 230, 9]\n\n[[steps]]\nname = \"take\""


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ((), ""),
        (((TAKE, "at_mm = [60, 230, 36]"),), "18"),
        (((TAKE, "at_mm = [60, 230, 36]"), ('[[steps]]\nname = "take"', TRAY)), ""),
        (((TAKE, f"{TAKE}\ngrid.count = [2, 1, 2]\ngrid.step_mm = [52, 0, 36]"),), ""),
    ],
)
def test_a_part_that_is_taken_from_the_air_is_told(
    tmp_path: Path, changes: tuple[tuple[str, str], ...], told: str
) -> None:
    task = read_program(pallet(tmp_path, *changes))
    found = list(taken_from_air(task, task.T_on_work))
    assert [words.partition(" mm above")[0] for words in found] == (
        [f"{task.file.name}: steps[0]: where part 1 is taken, it is {told}"] if told else []
    )
