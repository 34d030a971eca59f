"""Fault data and fault files: what is accepted, and how a mistake is told."""

from __future__ import annotations

from pathlib import Path

import pytest

from arm.errors import InputError
from arm.io.storage import data_file
from driver.emulator.faults.file import read_faults
from driver.emulator.faults.model import KINDS, NEEDED, USED, Fault, When


def written(folder: Path, text: str) -> Path:
    path = folder / "faults.toml"
    path.write_text(text)
    return path


@pytest.mark.parametrize("name", ["noisy-line", "emergency-stop", "bad-day"])
def test_the_examples_are_read(name: str) -> None:
    assert len(read_faults(data_file(f"scenes/faults/{name}.toml"))) >= 2


def test_a_file_says_what_the_data_type_says(tmp_path: Path) -> None:
    text = """
    [[fault]]
    kind = "power_off"
    [[fault]]
    kind = "delayed_bytes"
    when = { command = "HH", nth = 2, after_ms = 250 }
    direction = "to_host"
    delay_ms = 40
    line = 3
    seed = 7
    [[fault]]
    kind = "drift"
    when = { segment = 12 }
    axis = "D"
    counts_per_s = -3.5
    """
    assert read_faults(written(tmp_path, text)) == (
        Fault("power_off"),
        Fault("delayed_bytes", When(250, "HH", nth=2), direction="to_host", delay_ms=40, line=3, seed=7),
        Fault("drift", When(segment=12), axis="D", counts_per_s=-3.5),
    )


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "fault: is missing; it must be an array of tables"),
        ("fault = 3", "fault = 3: must be an array of tables"),
        ("[[fault]]\nkind = 'powr_off'", "fault[0].kind = 'powr_off': must be one of power_off, "),
        ("[[fault]]", "fault[0].kind: is missing; it must be one of"),
        ("[[fault]]\nkind = 'stuck_axis'", "fault[0].axis: is missing; it must be a string"),
        ("[[fault]]\nkind = 'stuck_axis'\naxis = 'AB'", "fault[0].axis = 'AB': must be A to H"),
        ("[[fault]]\nkind = 'power_off'\naxis = 'A'", "fault[0].axis = 'A': is not a known key"),
        ("[[fault]]\nkind = 'power_off'\nfor_ms = -1", "fault[0].for_ms = -1: must be from 0 to 1e+09"),
        ("[[fault]]\nkind = 'power_off'\nfor_ms = nan", "fault[0].for_ms = nan: must be a finite number"),
        ("[[fault]]\nkind = 'noise'\ncount = 1.5", "fault[0].count = 1.5: must be a whole number"),
        (
            "[[fault]]\nkind = 'lost_bytes'\nprobability = 2",
            "fault[0].probability = 2: must be above 0 and at most 1",
        ),
        (
            "[[fault]]\nkind = 'lost_bytes'\nbyte = 2\nline = 1",
            "fault[0].line = 1: cannot be given together with byte",
        ),
        (
            "[[fault]]\nkind = 'lost_bytes'\ndirection = 'up'",
            "fault[0].direction = 'up': must be one of to_unit, to_host, both, echo",
        ),
        (
            "[[fault]]\nkind = 'power_off'\nwhen = { command = 'FOO' }",
            "fault[0].when.command = 'FOO': must be one of ECHO",
        ),
        (
            "[[fault]]\nkind = 'power_off'\nwhen = { segment = 0 }",
            "fault[0].when.segment = 0: must be 1 or more",
        ),
        ("[[fault]]\nkind = 'power_off'\nwhen = 3", "fault[0].when = 3: must be a table"),
        (
            "[[fault]]\nkind = 'power_off'\nwhen = {at = 3}",
            "fault[0].when.at = 3: is not a known key",
        ),
        (
            "[[fault]]\nkind = 'power_off'\nwhen = {command = 'R:'}",
            "fault[0].when.command = 'R:': must be a command's name without marks",
        ),
        (
            "[[fault]]\nkind = 'power_off'\nwhen = {command = 'R', segment = 2}",
            "must be a command or a segment, not both",
        ),
        ("[[fault]]\nkind = 'power_off'\nwhen = {command = 'R', nth = 0}", "when.nth = 0: must be 1 or more"),
        (
            "[[fault]]\nkind = 'power_off'\n[[faults]]\nkind = 'drift'",
            "faults = [{'kind': 'drift'}]: is not a",
        ),
        ("[[fault]\n", "is not valid TOML"),
        pytest.param(
            "[[fault]]\nkind = 'noise'\n" * 1001, "has 1001 tables, must have at most 1000", id="1001 tables"
        ),
    ],
)
def test_a_mistake_is_told_with_file_key_value_and_rule(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(InputError) as caught:
        read_faults(written(tmp_path, text))
    told = str(caught.value)
    assert told.startswith(f"{tmp_path / 'faults.toml'}: ")
    assert message in told
    assert "\n" not in told[:200]
    assert caught.value.exit_code == 2


def test_a_file_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="nowhere"):
        read_faults(tmp_path / "nowhere.toml")


def test_every_kind_has_its_fields() -> None:
    assert set(USED) == set(KINDS)
    assert all(set(needed) <= set(USED[kind]) for kind, needed in NEEDED.items())
    told = {line.split()[0] for line in (Fault.__doc__ or "").splitlines() if line.strip()}
    assert set(KINDS) <= told
    page = (Path(__file__).parents[4] / "docs" / "emulator.md").read_text()
    assert all(f"`{name}`" in page for kind in KINDS for name in (kind, *USED[kind]))


def test_a_field_of_another_kind_is_refused() -> None:
    with pytest.raises(InputError, match="axis = 'A': is not a field of power_off: for_ms"):
        Fault("power_off", axis="A")
    with pytest.raises(InputError, match="must be given for lag"):
        Fault("lag")
    with pytest.raises(InputError, match="must be one of power_off"):
        Fault("flood")  # type: ignore[arg-type]
