"""Files are written whole or not at all; hashes depend on values only."""

import os
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import pytest

from arm.errors import FileInputError, InputError
from arm.io.storage import (
    MOST_BYTES,
    canonical_json,
    data_file,
    keep_unread,
    one_command,
    open_file,
    read_bytes,
    read_instead,
    read_json,
    read_text,
    require_finite,
    sha256,
    write_atomic,
)
from arm.io.toml_reader import read_toml


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


def test_parts_are_written_one_after_the_other(tmp_path: Path) -> None:
    write_atomic(tmp_path / "a", (text for text in ("x\n", "y\n")))
    assert (tmp_path / "a").read_text() == "x\ny\n"

    def broken() -> Iterator[str]:
        yield "z"
        raise OSError(5, "Input/output error")

    with pytest.raises(InputError, match="Input/output error"):
        write_atomic(tmp_path / "a", broken())
    assert (tmp_path / "a").read_text() == "x\ny\n"


def test_a_file_is_read_with_other_contents_inside_the_block_only(tmp_path: Path) -> None:
    file = tmp_path / "a.toml"
    file.write_text("a = 1")
    with read_instead({file: b"a = 2", tmp_path / "none.toml": b"b = 3"}):
        assert read_toml(tmp_path / "." / "a.toml") == {"a": 2}
        assert read_toml(tmp_path / "none.toml") == {"b": 3}
    assert read_toml(file) == {"a": 1}


def test_folders_are_made(tmp_path: Path) -> None:
    write_atomic(tmp_path / "a" / "b" / "c.txt", b"x")
    assert (tmp_path / "a" / "b" / "c.txt").read_bytes() == b"x"


def test_a_file_in_place_of_the_folder_is_refused(tmp_path: Path) -> None:
    write_atomic(tmp_path / "a", "x")
    for file in (tmp_path / "a" / "b", tmp_path / "a" / "b" / "c"):
        with pytest.raises(
            InputError, match=f"c?: cannot be written: {tmp_path / 'a'} is a file, not a folder$"
        ):
            write_atomic(file, "x")


def test_canonical_json_has_one_text_for_one_value() -> None:
    assert canonical_json({"b": 0.1, "a": [1, None]}) == '{"a":[1,null],"b":0.1}'
    assert sha256({"a": 1, "b": 2}) == sha256({"b": 2, "a": 1})
    with pytest.raises(ValueError, match="Out of range"):
        canonical_json({"a": float("nan")})


def test_data_files_are_found_and_a_missing_one_is_refused() -> None:
    assert data_file("urdf/a465/a465.urdf").is_file()
    with pytest.raises(InputError, match="reinstall"):
        data_file("urdf/none.urdf")


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
        (Path.mkdir, r"is a folder, must be a file"),
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


def test_a_folder_is_told_with_the_files_of_the_project_in_it(tmp_path: Path) -> None:
    for name in ("wire.jsonl", "report.json", "page.html", *(f"z{k}.toml" for k in range(4))):
        (tmp_path / name).touch()
    with pytest.raises(FileInputError) as refused:
        read_json(tmp_path)
    told = f"is a folder, must be a file (it is of a run: its log is {tmp_path / 'wire.jsonl'})"
    assert str(refused.value) == f"{tmp_path}: {told}"
    (tmp_path / "wire.jsonl").rename(tmp_path / "y.json")
    with pytest.raises(FileInputError) as refused:
        read_json(tmp_path)
    told = "is a folder, must be a file (it holds report.json, y.json, z0.toml, z1.toml, z2.toml, ...)"
    assert str(refused.value) == f"{tmp_path}: {told}"


@pytest.mark.parametrize("order", ["utf-16", "utf-16-be"])
def test_text_in_utf_16_is_told_as_that(tmp_path: Path, order: str) -> None:
    (tmp_path / "a.csv").write_bytes("\ufeff"[: order != "utf-16"].encode(order)[-2:] + "1,2\n".encode(order))
    with pytest.raises(FileInputError) as refused:
        read_text(tmp_path / "a.csv")
    told = "is UTF-16 text, as editors and spreadsheets write 'Unicode' (save it as UTF-8, a table as 'CSV UTF-8')"
    assert str(refused.value) == f"{tmp_path / 'a.csv'}: {told}"


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


def test_a_key_that_is_there_twice_is_refused_and_named(tmp_path: Path) -> None:
    """Of two values nobody knows which one is meant; a list that is written again would lose one."""
    file = tmp_path / "a.json"
    file.write_text('{"entries": [{"name": "a", "q_deg": [1], "q_deg": [2]}]}')
    with pytest.raises(FileInputError, match=r"a\.json: q_deg: is there twice in one object"):
        read_json(file)
    file.write_text('[{"a": 1}, {"a": 2, "b": {"a": 3}}]')
    assert read_json(file) == [{"a": 1}, {"a": 2, "b": {"a": 3}}]


def test_a_byte_order_mark_is_no_content(tmp_path: Path) -> None:
    file = tmp_path / "a.json"
    file.write_bytes(b'\xef\xbb\xbf{"a": 1}')
    assert read_json(file) == {"a": 1}
    file.write_bytes(b"\xef\xbb\xbfa = 1\n")
    assert read_text(file) == "a = 1\n"
    assert read_toml(file) == {"a": 1}


@pytest.mark.parametrize(
    ("text", "told"),
    [
        (
            '<?xml version="1.0"?>\n<robot name="a"/>',
            "is XML, such as a URDF (an arm file names a URDF: arm.urdf), and",
        ),
        ("\n<!DOCTYPE html>\n<html></html>", "is an HTML page, such as a preview or a report, and"),
        ("<HTML>", "is an HTML page, such as a preview or a report, and"),
        ("# of a topic\nheader:\n  stamp: 0\n", "looks like YAML, and"),
        ("---\nname: a\n", "looks like YAML, and"),
        ("%YAML:1.0\n---\nK: !!opencv-matrix\n", "looks like YAML, and"),
        ("- name: a\n", "looks like YAML, and"),
        ("joint_names: [J1]\n", "looks like YAML, and"),
        ("1, 2, 3\n", "is not JSON: "),
        ("see: no, http://a\n"[5:], "is not JSON: "),
        ("-1\n-2", "is not JSON: "),
        ("", "is empty, and a JSON file belongs here"),
        ("t,J1,J2\n0,1,2\n1,1,2\n", "is a table of numbers (CSV)"),
        ("0,1,2,3\n1,1,2,3\n", "is a table of numbers (CSV)"),
        ("{'a': 1}", "is not JSON: "),
    ],
)
def test_markup_and_yaml_in_place_of_json_are_told_as_such(tmp_path: Path, text: str, told: str) -> None:
    file = tmp_path / "a.json"
    file.write_text(text)
    with pytest.raises(InputError) as refused:
        read_json(file)
    assert str(refused.value).startswith(f"{file}: {told}")
    assert not told.endswith("and") or str(refused.value).endswith(f"{told} a JSON file belongs here")


def test_json_that_ends_early_or_has_a_comma_too_many_is_told_as_such(tmp_path: Path) -> None:
    file = tmp_path / "a.json"
    for text, told in (
        ('{"a": [1, 2', "(the file ends too early"),
        ('{"a": 1, ', "(the file ends too early"),
        ('{"a": "wor', "(the file ends too early"),
        ("[1, 2,]", "(a comma stands before a bracket that ends)"),
        ("[1 2]", "(char 3)"),
        ('{"a": 1}\n{"a": 2}\n', "(a second document follows the first; one document belongs here"),
    ):
        file.write_text(text)
        with pytest.raises(InputError) as refused:
            read_json(file)
        assert f"{file}: is not JSON: " in str(refused.value)
        assert told in str(refused.value)


def test_a_comment_in_json_is_told(tmp_path: Path) -> None:
    (tmp_path / "a.json").write_text('{"a": 1, // first\n"b": 2}')
    with pytest.raises(FileInputError, match=r"\(JSON has no comments\)$"):
        read_json(tmp_path / "a.json")


def test_what_python_prints_is_told(tmp_path: Path) -> None:
    (tmp_path / "a.json").write_text("{'a': 1}")
    with pytest.raises(FileInputError, match="double quotation marks: is it printed by Python"):
        read_json(tmp_path / "a.json")
