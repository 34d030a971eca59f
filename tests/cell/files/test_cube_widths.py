"""Widths of cubes that were in the jaws at a stop: what is written is read, and nothing else."""

from __future__ import annotations

from pathlib import Path

import pytest

from arm.errors import ExecutionStopped, FileInputError
from cell.files.cube_widths import FILE, read_widths, width_kept, write_widths
from vision.occupancy.seated import CubeWidth

NOMINAL = CubeWidth(0.040, 5e-5)
WIDTH = CubeWidth(0.04005, 1.2e-5)


def test_what_is_written_is_read(tmp_path: Path) -> None:
    assert read_widths(tmp_path, NOMINAL) == {}
    write_widths(tmp_path, {"cube 01-02/1": WIDTH})
    ((name, width),) = read_widths(tmp_path, NOMINAL).items()
    assert name == "cube 01-02/1"
    assert (width.value, width.std) == pytest.approx((WIDTH.value, WIDTH.std))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[1]", "widths.json: must be a table"),
        ('{"cube 1": 40}', "cube 1 = 40: must be a table"),
        ('{"cube 1": {"width_mm": 40}}', r"cube 1.std_mm: is missing; .*remove the file"),
        (
            '{"cube 1": {"width_mm": "wide", "std_mm": 0.01}}',
            "cube 1.width_mm = 'wide': must be a finite number in mm",
        ),
        ('{"cube 1": {"width_mm": 40.4, "std_mm": 0.01}}', "must be a width of this cell's cubes, 40 mm"),
        ('{"cube 1": {"width_mm": 39.6, "std_mm": 0.01}}', "must be a width of this cell's cubes, 40 mm"),
        ('{"cube 1": {"width_mm": NaN, "std_mm": 0.01}}', "width_mm = nan: must be a finite number"),
        ('{"cube 1": {"width_mm": 40, "std_mm": Infinity}}', "std_mm = inf: must be a finite number"),
        ('{"cube 1": {"width_mm": 40, "std_mm": 0}}', "must be a width of this cell's cubes"),
        ("{", "is not JSON"),
    ],
)
def test_what_is_no_width_is_refused_in_one_line(tmp_path: Path, text: str, words: str) -> None:
    (tmp_path / FILE).write_text(text)
    with pytest.raises(FileInputError, match=words) as refused:
        read_widths(tmp_path, NOMINAL)
    assert FILE in str(refused.value)
    assert "\n" not in str(refused.value)


def test_a_width_is_kept_only_where_the_cube_is_in_the_jaws(tmp_path: Path) -> None:
    for data, kept in (({}, False), ({"holding": "cube 2"}, False), ({"holding": "cube 1"}, True)):
        with pytest.raises(ExecutionStopped, match="aborted"), width_kept(tmp_path, "cube 1", lambda: WIDTH):
            raise ExecutionStopped("aborted", **data)
        assert (tmp_path / FILE).exists() is kept
    (tmp_path / FILE).unlink()
    with width_kept(tmp_path, "cube 1", lambda: WIDTH):
        pass
    assert not (tmp_path / FILE).exists()
    with pytest.raises(ExecutionStopped), width_kept(tmp_path, "cube 1", lambda: None):
        raise ExecutionStopped("aborted", holding="cube 1")
    assert not (tmp_path / FILE).exists()
