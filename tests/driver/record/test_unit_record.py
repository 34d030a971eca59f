"""The file of a recording: written and read again, and refused if a value is wrong."""

from __future__ import annotations

import json
import random
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from arm.errors import FileInputError
from driver.record.tape import Event
from driver.record.unit_record import Ended, UnitRecord, read_unit_record
from typed.any_type import JSON, keys_of, with_value, without


def made(seed: int) -> UnitRecord:
    rng = random.Random(seed)
    events = tuple(
        Event(
            round(t + rng.random(), 6), rng.choice(("sent", "received")), rng.randbytes(20).decode("latin-1")
        )
        for t in range(20)
    )
    manners = rng.choice([None, {"echoes": True, "adapter": False, "takes_turns": True}])
    return UnitRecord(2.5, rng.choice(list(Ended)), manners, (Event(0.0, "step", "as found"), *events))


@pytest.mark.parametrize("seed", range(10))
def test_what_was_written_is_read_again(tmp_path: Path, seed: int) -> None:
    file = tmp_path / "unit.json"
    file.write_text(made(seed).to_json())
    assert read_unit_record(file) == made(seed)
    assert len(file.read_text().splitlines()) == 21 + 9, "an event a line"


def test_an_empty_recording_is_read_again(tmp_path: Path) -> None:
    record = replace(made(1), events=())
    (tmp_path / "unit.json").write_text(record.to_json())
    assert read_unit_record(tmp_path / "unit.json") == record


def test_the_file_has_the_keys_that_its_page_lists(tmp_path: Path) -> None:
    value = json.loads(made(3).to_json())
    assert set(value) == {"format", "version", "seconds", "ended", "manners", "events"}
    assert {key for event in value["events"] for key in event} == {"t", "kind", "data"}


@pytest.mark.parametrize(
    ("key", "value", "rule"),
    [
        ("format", "a plan", "must be one of a465 unit record"),
        ("version", 2, "must be a whole number from 1 to 1"),
        ("ended", "well", "must be one of complete"),
        ("seconds", -1, "must be a number in s from 0"),
        ("manners", {"echoes": True}, "is missing"),
        ("events", {}, "must be an array of tables"),
        ("events", [{"t": 0.0, "kind": "heard", "data": ""}], "must be one of step, sent, received"),
    ],
)
def test_a_wrong_value_is_told_with_its_key(tmp_path: Path, key: str, value: Any, rule: str) -> None:
    file = tmp_path / "unit.json"
    file.write_text(json.dumps(json.loads(made(0).to_json()) | {key: value}))
    with pytest.raises(FileInputError) as refused:
        read_unit_record(file)
    assert rule in str(refused.value)
    assert key in str(refused.value)


def test_any_value_of_any_key_is_read_or_refused(tmp_path: Path) -> None:
    whole = json.loads(
        replace(made(1), manners={"echoes": True, "adapter": False, "takes_turns": True}).to_json()
    )
    file = tmp_path / "unit.json"
    for key in keys_of(whole):
        for spoilt in (without(whole, key), *(with_value(whole, key, value) for value in JSON)):
            file.write_text(json.dumps(spoilt))
            with suppress(FileInputError):
                read_unit_record(file)
