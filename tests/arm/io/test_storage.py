"""Files are written whole or not at all; hashes depend on values only."""

import os
from collections.abc import Callable
from functools import partial
from pathlib import Path

import pytest

from arm.errors import FileInputError, InputError
from arm.io.storage import (
    MOST_BYTES,
    canonical_json,
    data_file,
    keep_apart,
    keep_unread,
    one_command,
    open_file,
    read_bytes,
    read_json,
    read_text,
    require_finite,
    sha256,
    write_atomic,
)


def test_an_older_file_survives_a_failed_write(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "a.json"
    write_atomic(path, "old")

    def full(handle: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(InputError, match="No space left"):
        write_atomic(path, "new")
    assert path.read_text() == "old"
    assert [p.name for p in tmp_path.iterdir()] == ["a.json"]


def test_folders_are_made(tmp_path: Path) -> None:
    write_atomic(tmp_path / "a" / "b" / "c.txt", b"x")
    assert (tmp_path / "a" / "b" / "c.txt").read_bytes() == b"x"


def test_a_file_in_place_of_the_folder_is_refused(tmp_path: Path) -> None:
    write_atomic(tmp_path / "a", "x")
    with pytest.raises(InputError, match="cannot be written"):
        write_atomic(tmp_path / "a" / "b", "x")


def test_canonical_json_has_one_text_for_one_value() -> None:
    assert canonical_json({"b": 0.1, "a": [1, None]}) == '{"a":[1,null],"b":0.1}'
    assert sha256({"a": 1, "b": 2}) == sha256({"b": 2, "a": 1})
    with pytest.raises(ValueError, match="Out of range"):
        canonical_json({"a": float("nan")})


def test_data_files_are_found_and_a_missing_one_is_refused() -> None:
    assert data_file("urdf/a465/a465.urdf").is_file()
    with pytest.raises(InputError, match="reinstall"):
        data_file("urdf/none.urdf")


def test_an_input_is_not_overwritten_under_any_name(tmp_path: Path) -> None:
    read, other = tmp_path / "plan.json", tmp_path / "page.html"
    read.write_text("{}")
    (tmp_path / "link").symlink_to(read)
    os.link(read, tmp_path / "hard")
    for name in ("plan.json", "link", "hard"):
        with pytest.raises(InputError, match=f"{name}: is read by this command"):
            keep_apart(tmp_path / name, other, None, read)
    keep_apart(other, read)
    keep_apart(None, read)
    other.touch()
    keep_apart(other, read, tmp_path / "not there")


def test_a_command_does_not_read_what_it_will_overwrite(tmp_path: Path) -> None:
    """A file that its input names, by any name; until the command ends, and not what it has written itself."""
    output, other = tmp_path / "cell.toml", tmp_path / "other.toml"
    output.write_text("a = 1")
    other.write_text("a = 2")
    os.link(output, tmp_path / "hard")
    with one_command():
        keep_unread(output, None, tmp_path / "not there")
        assert read_text(other) == "a = 2"
        for name in ("cell.toml", "hard"):
            with pytest.raises(
                InputError, match=f"{name}: is read by this command, so it is not overwritten"
            ):
                read_text(tmp_path / name)
    assert read_text(output) == "a = 1"
    with one_command():
        keep_unread(output)
        write_atomic(output, "b = 1")
        assert read_text(output) == "b = 1"
    keep_unread(output)
    assert read_text(output) == "b = 1"


@pytest.mark.parametrize("name", ["a\0b", "a\ud800b"])
def test_an_invalid_file_name_is_refused(name: str) -> None:
    with pytest.raises(FileInputError, match="is not a file name"):
        read_text(Path(name))


def test_a_link_stays_a_link_and_a_mode_stays_what_it_was(tmp_path: Path) -> None:
    real, link = tmp_path / "folder" / "real.txt", tmp_path / "link.txt"
    real.parent.mkdir()
    real.write_text("before")
    real.chmod(0o640)
    link.symlink_to(real)
    write_atomic(link, "after")
    assert link.is_symlink()
    assert real.read_text() == "after"
    assert real.stat().st_mode & 0o777 == 0o640
    assert [p.name for p in real.parent.iterdir()] == ["real.txt"]


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ('{"a": {"b": [1, NaN]}}', r"a\.b\[1\] = nan: must be a finite number"),
        ('[{"a": -Infinity}]', r"\[0\]\.a = -inf: must be a finite number"),
        ('{"a": [1, -1e200]}', r"a\[1\] = -1e\+200: must be a number from -1e\+100 to 1e\+100"),
        ('{"a": [1, ' + "9" * 400 + "]}", r"a\[1\] = 9.*must be a whole number of at most 64 bits"),
        ('{"a": ' + "9" * 5000 + "}", "has a number of more than"),
    ],
)
def test_json_with_unwritable_numbers_is_refused(tmp_path: Path, text: str, told: str) -> None:
    (tmp_path / "a.json").write_text(text)
    with pytest.raises(FileInputError, match=rf"a\.json: {told}"):
        require_finite(tmp_path / "a.json", read_json(tmp_path / "a.json"))


def test_finite_values_are_accepted(tmp_path: Path) -> None:
    require_finite(tmp_path, {"a": [1, 2.5, None, "NaN", True, {"b": 1e100}]})


def _pipe(path: Path) -> None:
    os.mkfifo(path)


@pytest.mark.parametrize(
    ("make", "what"),
    [
        (_pipe, "a named pipe"),
        (lambda path: path.symlink_to("/dev/zero"), "a character device"),
        (lambda path: path.symlink_to("/dev/tty0000"), "cannot be read: No such file"),
        (Path.mkdir, "cannot be read: Is a directory"),
    ],
)
def test_only_regular_files_are_read_and_nothing_is_waited_for(
    tmp_path: Path, make: Callable[[Path], None], what: str
) -> None:
    make(tmp_path / "a")
    for read in (
        read_text,
        read_json,
        partial(read_bytes, kind="photograph"),
        partial(open_file, kind="log"),
    ):
        with pytest.raises(FileInputError, match=rf"a: .*{what}"):
            read(tmp_path / "a")


@pytest.mark.parametrize("kind", sorted(MOST_BYTES))
def test_each_kind_of_file_has_a_size_limit(
    tmp_path: Path, kind: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(MOST_BYTES, kind, 1000)
    (tmp_path / "a").write_bytes(b" " * 1000)
    assert len(read_bytes(tmp_path / "a", kind)) == 1000
    (tmp_path / "a").write_bytes(b" " * 1001)
    for read in (read_bytes, open_file):
        with pytest.raises(FileInputError, match=f"has more than 0 MB, which is the limit for a {kind} file"):
            read(tmp_path / "a", kind)


def test_a_file_that_says_it_is_empty_and_is_not_is_read_to_its_limit(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    assert b"Linux" in read_bytes(Path("/proc/version"), "text")
    monkeypatch.setitem(MOST_BYTES, "text", 3)
    with pytest.raises(FileInputError, match="limit for a text file"):
        read_bytes(Path("/proc/version"), "text")


def test_line_ends_are_pythons(tmp_path: Path) -> None:
    (tmp_path / "a").write_bytes(b"a\r\nb\rc\n")
    assert read_text(tmp_path / "a") == (tmp_path / "a").read_text() == "a\nb\nc\n"
