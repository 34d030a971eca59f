"""What kind a file is: of every file of the project, and of contents that show none."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from arm.errors import FileInputError
from arm.io.kind import KINDS, kind_of, read_any, read_kind, require_kind
from arm.io.storage import data_file, read_json
from arm.io.toml_reader import read_toml

SHIPPED = {
    "*task?.toml": "task",
    "*cell.toml": "cell",
    "*.world.toml": "world",
    "cameras/*.toml": "camera",
    "realistic/calibration.toml": "calibration",
    "targets/*.toml": "target",
    "faults/*.toml": "faults",
    "fixtures/*.toml": "scene",
    "hoop/wires/*.toml": "wire",
    "hoop/boards/*.toml": "board",
    "*/tools/*.toml": "tool",
    "pen/drawing.toml": "program",
    "pallet.toml": "program",
}


@pytest.mark.parametrize(("files", "kind"), SHIPPED.items())
def test_shipped_files_are_recognised_and_refused_where_another_belongs(files: str, kind: str) -> None:
    found = sorted(data_file("scenes").glob(files))
    assert found
    for file in found:
        assert kind_of(read_kind(file, read_toml, kind)) == kind
        for read, other in ((read_toml, "report"), (read_json, "look")):
            with pytest.raises(FileInputError) as refused:
                read_kind(file, read, other)
            assert f"{file}: is {KINDS[kind].words}, and {KINDS[other].words} belongs here" in str(
                refused.value
            )


@pytest.mark.parametrize(
    ("kind", "marks"), [(name, one) for name, kind in KINDS.items() for one in kind.marks]
)
def test_the_marks_of_a_kind_are_of_no_kind_before_it(kind: str, marks: frozenset[str]) -> None:
    value = {mark.removesuffix("[]"): [] if mark.endswith("[]") else 0 for mark in marks}
    assert kind_of(value) == kind
    assert all(kind_of({k: v for k, v in value.items() if k != mark}) != kind for mark in value)


def test_what_shows_no_kind_passes_and_what_cannot_be_read_keeps_its_cause(tmp_path: Path) -> None:
    file = tmp_path / "a.json"
    for value in (3, [], {}, {"boards": {}}, {"names": "task"}):
        file.write_text(json.dumps(value))
        assert read_kind(file, read_json, "plan") == value
    for text in ("{", "a = 1", "[1", '{"t": 0}\n{"t": 1}'):
        file.write_text(text)
        with pytest.raises(FileInputError, match="is not JSON"):
            read_kind(file, read_json, "plan")
    with pytest.raises(FileInputError, match="is a folder, must be a file"):
        read_kind(tmp_path, read_json, "plan")


def test_a_log_is_known_by_its_first_line(tmp_path: Path) -> None:
    log = tmp_path / "wire.jsonl"
    log.write_text('{"t": 0.0, "kind": "open"}\n{"t": 0.1, "kind": "sent"}\n')
    for read in (read_json, read_toml):
        with pytest.raises(FileInputError, match="is the log of a run, and a plan belongs here"):
            read_kind(log, read, "plan")


def test_a_task_in_place_of_a_recording_is_told_how_one_is_made() -> None:
    file = data_file("scenes/task2.toml")
    with pytest.raises(
        FileInputError, match=r"is a task file, .* belongs here \(--collect TASK makes a recording"
    ):
        require_kind(file, read_any(file), "recording")
