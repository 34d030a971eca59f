"""A ring whose threading could not be proved, or whose path begins at the wrong end, is refused with its place."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from arm.errors import InputError
from arm.io.storage import data_file
from cell.program.program_file import read_program
from typed.command_line import replace_in

_WIRE = '[[bodies]]\nfile = "wires/b.toml"\n'
_STEP = '\n[[steps]]\nname = "again"\nline_of = "FILE"\naxis = "along"\nthreaded = "RING"\n'
_BODY = "centre_mm = [0, 300, 0]\nsize_mm = [9, 9, 9]\n"


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (_WIRE, "", r"steps\[0\].line_of = 'wires/b.toml': must be a wire file with bodies that is also"),
        ("back = true", 'back = true\ntouch = [["ring 1", "bar 2"]]', r"steps\[0\].touch.*lets 'ring 1' touch 'bar 2'"),
        (_WIRE, f'{_WIRE}[[bodies]]\nname = "beyond b"\n{_BODY}', r"steps\[0\].threaded.*a body named 'beyond b'"),
        (_WIRE, f'{_WIRE}[[bodies]]\nname = ""\n{_BODY}', r"bodies\[1\].name = '': must not be empty"),
        ("", _STEP.replace("FILE", "wires/b.toml").replace("RING", "ring 2"), r"steps\[1\].threaded.*of another ring"),
        ("", _STEP.replace("FILE", "other/b.toml").replace("RING", "ring 1"), r"steps\[1\].threaded.*another ring or"),
        ("wires/b", "longer/b", r"steps\[0\].line_of.*do not contain its line_mm, at .70.0, 0.0, 20[01].\d. mm"),
    ],
)  # fmt: skip
def test_a_threaded_ring_of_which_nothing_would_be_proved_is_refused(
    tmp_path: Path, old: str, new: str, message: str
) -> None:
    folder = Path(shutil.copytree(data_file("scenes"), tmp_path / "scenes")) / "hoop"
    file, wire = folder / "b.toml", (folder / "wires/b.toml").read_text()
    for name, end in (("other", 190), ("longer", 210)):
        (folder / name).mkdir()
        (folder / name / "b.toml").write_text(wire.replace("[70, 0, 200]", f"[70, 0, {end}]"))
    text = file.read_text()
    file.write_text(text.replace(old, new) if old else text + new)
    with pytest.raises(InputError, match=message):
        read_program(file)


_LINE = "  [0, 0, 0],\n  [0, 0, 80],\n  [70, 0, 150],\n  [70, 0, 200],\n"
_TURNED = "reverse line_mm of its file, which is from the foot to the free end"


@pytest.mark.parametrize("mistake", ["backwards is left out", "the line is from its free end"])
def test_a_threaded_path_from_the_foot_is_told_before_it_is_planned(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, mistake: str
) -> None:
    shutil.copytree(data_file("scenes"), tmp_path / "scenes")
    monkeypatch.chdir(tmp_path)  # a long name would be shortened in the message
    folder = Path("scenes/hoop")
    file, wire, given = folder / "b.toml", folder / "wires/b.toml", _TURNED
    if mistake == "backwards is left out":
        text = file.read_text()
        file.write_text("\n".join(row for row in text.splitlines() if not row.startswith("backwards")))
        given = f"give backwards = true, or {_TURNED}"
    else:
        replace_in(wire, _LINE, "".join(reversed(_LINE.splitlines(keepends=True))))
    with pytest.raises(InputError) as refused:
        read_program(file)
    assert str(refused.value) == (
        f"{file}: steps[0].threaded = 'ring 1': cannot be on its path: 20 mm from its start, at (0, 0, -20) mm, it is "
        f"in 'foam' (a path with threaded begins at the free end: {given})"
    )


@pytest.mark.parametrize("tool", ["-135, 0, 13", "-135, 20, 60"])
def test_a_ring_that_is_not_about_the_tool_frame_is_told(tmp_path: Path, tool: str) -> None:
    """Within the ring, and anywhere along its axis, the frame may be."""
    folder = Path(shutil.copytree(data_file("scenes"), tmp_path / "scenes")) / "hoop"
    replace_in(folder / "tools/hoop.toml", "origin_mm = [-135, 0, 13]", f"origin_mm = [{tool}]")
    assert read_program(folder / "b.toml").threads
    replace_in(folder / "tools/hoop.toml", f"origin_mm = [{tool}]", "origin_mm = [-13.5, 0, 1.3]")  # cm
    told = (
        r"steps\[0\].threaded = 'ring 1': must be about the origin of the tool frame, which follows the line: its axis "
        r"passes it by 121\.5 mm, its radius is 34\.71 mm \(is origin_mm of the tool's file right, and in mm\?\)$"
    )
    with pytest.raises(InputError, match=told):
        read_program(folder / "b.toml")
