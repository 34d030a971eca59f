"""A calibration's name comes into a cell file, and nothing else in it changes: texts, links, modes, refusals."""

from __future__ import annotations

import random
import re
import shutil
import stat
import tomllib
from pathlib import Path

import pytest

from arm.calibration_file import ArmCalibration, write_arm_calibration
from arm.errors import FileInputError, InputError
from arm.io.storage import data_file
from arm.robot.dh import A465
from arm.robot.link_errors import LinkErrors
from arm.se3 import frozen
from cell.config.cell_file import read_cell
from cell.files.apply_calibration import apply_calibration

NAMED = 'calibration = "c.toml"'


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Of a cell file, with a calibration of this cell in ``c.toml`` and of another unit in ``other.toml``."""
    shutil.copytree(data_file("scenes"), tmp_path / "scenes")
    here = tmp_path / "scenes" / "uncalibrated"
    camera = read_cell(here / "cell.toml").camera
    for name, unit in (("c.toml", "crs93"), ("other.toml", "crs97")):
        found = ArmCalibration(
            camera.T_base_camera, frozen([0.0] * 6), LinkErrors.none(), unit, camera.lens_digest, A465.digest
        )
        write_arm_calibration(here / name, found)
    return here


@pytest.fixture
def any_toml(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A file that may say anything: whether it makes a cell is not asked."""
    monkeypatch.setattr("cell.files.apply_calibration.read_cell", lambda path: None)
    return tmp_path / "cell.toml"


@pytest.mark.parametrize(
    ("before", "after"),
    [
        ("a = 1\n", f"a = 1\n{NAMED}\n"),
        ("a = 1", f"a = 1\n{NAMED}\n"),
        ("", f"{NAMED}\n"),
        ("# only\n", f"{NAMED}\n# only\n"),
        ("a = 1\r\n\r\n[t]\r\nb = 2", f"a = 1\r\n{NAMED}\r\n\r\n[t]\r\nb = 2"),
        ("a = 1\n# of t\n[t]\n", f"a = 1\n{NAMED}\n# of t\n[t]\n"),
        ("a = 1\n\n# of t\n\n# more\n[t]\n", f"a = 1\n{NAMED}\n\n# of t\n\n# more\n[t]\n"),
        ("# of t\n[t]\nb = 1\n", f"{NAMED}\n# of t\n[t]\nb = 1\n"),
        ("a = 1  # of a,\n       # goes on\n[t]\n", f"a = 1  # of a,\n       # goes on\n{NAMED}\n[t]\n"),
        ("a = [\n  [1],  # x\n\n]\n[[t]]\n", f"a = [\n  [1],  # x\n\n]\n{NAMED}\n[[t]]\n"),
        ('a = """\n[t]\n"""\nb.c = 1\n[t]\n', f'a = """\n[t]\n"""\nb.c = 1\n{NAMED}\n[t]\n'),
        ('a = 1\n[t]\ncalibration = "mine"\n', f'a = 1\n{NAMED}\n[t]\ncalibration = "mine"\n'),
        (
            "a = 1\n[t]\nb = '''\ncalibration = 'x'\n'''\n",
            f"a = 1\n{NAMED}\n[t]\nb = '''\ncalibration = 'x'\n'''\n",
        ),
        ("a = 'a\u2028[t]\u0085'\n", f"a = 'a\u2028[t]\u0085'\n{NAMED}\n"),
    ],
)
def test_a_new_key_stands_below_the_other_keys(any_toml: Path, before: str, after: str) -> None:
    any_toml.write_bytes(before.encode())
    assert apply_calibration(any_toml, any_toml.parent / "c.toml") == NAMED
    assert any_toml.read_bytes().decode() == after


@pytest.mark.parametrize(
    ("before", "after"),
    [
        ('calibration = "b.toml" # of May\na = 1\n', 'calibration = "c.toml" # of May\na = 1\n'),
        ('calibration="b.toml"', 'calibration="c.toml"'),
        ("\t calibration\t= 'b' # 'x'\r\n[t]\r\n", "\t calibration\t= \"c.toml\" # 'x'\r\n[t]\r\n"),
        (' "calibration" = "a\\"#"#"\n', ' "calibration" = "c.toml"#"\n'),
        ("'calibration' = ''\n", "'calibration' = \"c.toml\"\n"),
        ('calibration = """\nb\\\n  c""" # x\na = """y"""\n', 'calibration = "c.toml" # x\na = """y"""\n'),
        ("calibration = '''b\n'''\n", 'calibration = "c.toml"\n'),
        (
            'a = """\ncalibration = "x"\n"""\ncalibration = "b"\n[t]\ncalibration = "y"\n',
            'a = """\ncalibration = "x"\n"""\ncalibration = "c.toml"\n[t]\ncalibration = "y"\n',
        ),
        ('# calibration = "x"\ncalibration = "b"\n', '# calibration = "x"\ncalibration = "c.toml"\n'),
    ],
)
def test_a_key_that_is_there_gets_another_value(any_toml: Path, before: str, after: str) -> None:
    any_toml.write_bytes(before.encode())
    assert apply_calibration(any_toml, any_toml.parent / "c.toml") == NAMED
    assert any_toml.read_bytes().decode() == after


PIECES = (
    "# a comment\n",
    "\n",
    '{} = 1 # calibration = "x"\n    # goes on\n',
    "  {} = [\n  [1, 2], # of it\n# [x]\n  [3, 4]\n]\n",
    '{} = """\n[x]\n\ncalibration = "x"\n# y\n"""\n',
    "{}.sub = '[x]'\n",
)


@pytest.mark.slow
@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_whatever_the_file_is_one_line_comes_into_it(any_toml: Path, end: str) -> None:
    """300 files of random pieces; the key is written, and then written again."""
    rng = random.Random(4)
    for _ in range(300):
        top, below = ([rng.choice(PIECES) for _ in range(rng.randrange(6))] for _ in range(2))
        pieces = [*top, rng.choice(("[t]\n", "[[t]] # t\n", '["calibration.t"]\n')), *below]
        before = "".join(piece.format(f"k{n}") for n, piece in enumerate(pieces)).replace("\n", end)
        any_toml.write_bytes(before.encode())
        apply_calibration(any_toml, any_toml.parent / "b.toml")
        once = any_toml.read_bytes().decode()
        assert once.replace(f'calibration = "b.toml"{end}', "") == before
        assert tomllib.loads(once) == tomllib.loads(before) | {"calibration": "b.toml"}
        above = once.partition('calibration = "b.toml"')[0]
        assert not above or above.rstrip(" \t\r\n").splitlines()[-1][:1] != "#"
        apply_calibration(any_toml, any_toml.parent / "c.toml")
        assert any_toml.read_bytes().decode() == once.replace("b.toml", "c.toml")


@pytest.mark.parametrize("name", ['a "b" \\ c.toml', "ä\u2028.toml", "\t#'''.toml", "\x7f.toml"])
def test_any_name_is_read_as_it_was_given(any_toml: Path, name: str) -> None:
    any_toml.write_text("a = 1\n")
    apply_calibration(any_toml, any_toml.parent / name)
    assert tomllib.loads(any_toml.read_bytes().decode()) == {"a": 1, "calibration": name}


@pytest.mark.parametrize(
    ("before", "name"),
    [
        ("[calibration]\na = 1\n", "c.toml"),
        ("calibration.a = 1\n", "c.toml"),
        ('"\\u0063alibration" = "b"\n', "c.toml"),
        ("a = 1\n", "\udcff.toml"),  # UTF-8 has no such character
    ],
)
def test_what_cannot_be_written_leaves_the_file_alone(any_toml: Path, before: str, name: str) -> None:
    any_toml.write_text(before)
    written = any_toml.stat().st_ino
    with pytest.raises(InputError, match=r"cell\.toml: its key calibration cannot be written") as caught:
        apply_calibration(any_toml, any_toml.parent / name)
    assert caught.value.data["key"] == "calibration"
    assert "by hand" in str(caught.value)
    assert any_toml.read_text() == before
    assert any_toml.stat().st_ino == written


def test_a_linked_cell_file_stays_a_link(folder: Path) -> None:
    """Names in it are relative to the link's folder, its own as the others."""
    kept = folder.parent / "kept" / "of the cell.toml"
    kept.parent.mkdir()
    (folder / "cell.toml").rename(kept)
    (folder / "cell.toml").symlink_to(kept)
    before = kept.read_text()
    assert apply_calibration(folder / "cell.toml", folder / "c.toml") == NAMED
    assert (folder / "cell.toml").is_symlink()
    assert kept.read_text().replace(f"{NAMED}\n", "") == before
    assert read_cell(folder / "cell.toml").calibration is not None
    assert [path.name for path in kept.parent.iterdir()] == ["of the cell.toml"]


def test_the_folder_may_be_linked_too(folder: Path) -> None:
    (folder.parent / "deep" / "er").mkdir(parents=True)
    shutil.copy(folder / "c.toml", folder.parent / "deep")
    link = folder.parent / "deep" / "er" / "link"
    link.symlink_to(folder)
    line = apply_calibration(link / "cell.toml", folder.parent / "deep" / "c.toml")
    assert line == 'calibration = "../deep/c.toml"'
    assert read_cell(link / "cell.toml").calibration is not None


@pytest.mark.parametrize("mode", [0o600, 0o664, 0o444])
def test_the_mode_of_the_file_stays(folder: Path, mode: int) -> None:
    cell = folder / "cell.toml"
    cell.chmod(mode)
    with pytest.raises(InputError):
        apply_calibration(cell, folder / "other.toml")
    assert stat.S_IMODE(cell.stat().st_mode) == mode
    apply_calibration(cell, folder / "c.toml")
    assert stat.S_IMODE(cell.stat().st_mode) == mode


def test_a_refused_calibration_leaves_every_byte(folder: Path) -> None:
    cell = folder / "cell.toml"
    cell.write_bytes(cell.read_bytes().replace(b"\n", b"\r\n"))
    before = cell.read_bytes()
    with pytest.raises(InputError, match=r"is of crs97, but unit is crs93.*left as it was"):
        apply_calibration(cell, folder / "other.toml")
    assert cell.read_bytes() == before


def test_a_cell_file_that_cannot_be_read_is_named(folder: Path) -> None:
    (folder / "round.toml").symlink_to("round.toml")
    (folder / "bad.toml").write_text("a = \n")
    for name in ("none.toml", "round.toml", "bad.toml"):
        with pytest.raises(FileInputError, match=re.escape(name)):
            apply_calibration(folder / name, folder / "c.toml")
    assert (folder / "bad.toml").read_text() == "a = \n"
