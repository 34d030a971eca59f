"""Series as MCAP."""

from __future__ import annotations

import builtins
import json
from pathlib import Path
from typing import Any

import pytest
from mcap.reader import make_reader

from arm.controller.unit import Unit, load_unit
from arm.errors import InputError
from arm.io.storage import data_file
from cell.console import Console
from cell.export.export import ExportOptions, export_file
from cell.export.series import executed, planned
from driver.log.read import Session
from typed.command_line import a465
from wire.exported import export, seconds
from wire.logged_session import LoggedRun

pytestmark = pytest.mark.xdist_group("logs")


@pytest.fixture(scope="module")
def unit() -> Unit:
    return load_unit("crs93")


def test_mcap_reads_back_with_its_schemas(
    run: LoggedRun, session: Session, unit: Unit, tmp_path: Path
) -> None:
    told = export(run, "mcap", tmp_path / "log.mcap")
    again = export(run, "mcap", tmp_path / "again.mcap")
    assert (tmp_path / "log.mcap").read_bytes() == (tmp_path / "again.mcap").read_bytes()
    assert told["messages"] == again["messages"]
    found: dict[str, list[tuple[int, dict[str, Any]]]] = {}
    with (tmp_path / "log.mcap").open("rb") as stream:
        for schema, channel, message in make_reader(stream).iter_messages():
            assert schema is not None
            assert (schema.encoding, channel.message_encoding) == ("jsonschema", "json")
            value = json.loads(message.data)
            assert set(value) == set(json.loads(schema.data)["properties"])
            found.setdefault(channel.topic, []).append((message.log_time, value))
    assert {topic: len(messages) for topic, messages in found.items()} == told["messages"]
    seen = executed(session, unit)
    assert len(found["/joint_states"]) == len(seen.time_s)
    for (time_ns, state), q, time_s in zip(found["/joint_states"], seen.q, seen.time_s, strict=True):
        assert state["position"] == pytest.approx(q, abs=1e-9)
        assert time_ns == pytest.approx(1e9 * time_s, abs=1e3)
        assert seconds(state["header"]["stamp"]) == pytest.approx(time_s, abs=1e-6)
    assert len(found["/planned"]) == len(planned(session, unit))
    kinds = [event["kind"] for _, event in found["/events"]]
    assert kinds.count("stop") == 2
    assert kinds.count("sent") == len(session.stops) >= 2  # STOP goes again until it has come back
    assert found["/jaws"][-1][1]["fraction_closed"] == pytest.approx(
        unit.gripper.fraction_closed(420), abs=1e-3
    )


def test_without_the_library_it_is_told_how_to_get_it(
    run: LoggedRun, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    real = builtins.__import__

    def missing(name: str, *rest: Any) -> Any:
        if name.split(".")[0] == "mcap":
            raise ImportError(name)
        return real(name, *rest)

    monkeypatch.setattr(builtins, "__import__", missing)
    with pytest.raises(InputError, match="make mcap"):
        export(run, "mcap", tmp_path / "log.mcap")
    assert not (tmp_path / "log.mcap").exists()


def test_a_log_shows_its_cell_and_the_images_of_its_looks(run: LoggedRun, tmp_path: Path) -> None:
    log = tmp_path / "wire.jsonl"
    lines = run.log.read_text().splitlines()
    end_s = json.loads(lines[-1])["t"]
    looks = [
        {"t": end_s, "kind": "look", "picture": name, "why": "a test"} for name in ("look-1.png", "../a.png")
    ]
    log.write_text("\n".join([*lines, *map(json.dumps, looks)]) + "\n")
    for name in ("look-1.png", "../a.png"):  # the second is not in the log's folder, so it is left out
        (tmp_path / name).write_bytes(b"an image")
    without, with_cell = (
        export_file(log, ExportOptions("mcap", tmp_path / f"{n}.mcap", cell=cell), Console(as_json=True))[
            "messages"
        ]
        for n, cell in enumerate((None, data_file("scenes/cell.toml")))
    )
    assert without["/images"] == with_cell["/images"] == 1
    assert "/tf" not in without
    assert with_cell["/tf"] == with_cell["/joint_states"]
    assert (with_cell["/scene"], with_cell["/robot_description"]) == (1, 1)
    for form in ("csv", "trajectory"):
        with pytest.raises(InputError, match="--cell goes with --format mcap only"):
            export_file(log, ExportOptions(form, cell=data_file("scenes/cell.toml")), Console(as_json=True))


def test_a_cell_with_another_tool_than_the_plans_of_a_log_is_told(
    run: LoggedRun, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "list.json").write_text('{"entries": [{"q_deg": [-60, -40, -80, 0, -55, 0]}]}')
    a465("plan", data_file("scenes/cell.toml"), "list.json", "-o", "plan.json", cwd=tmp_path)
    lines = run.log.read_text().splitlines()
    note = {"t": json.loads(lines[-1])["t"], "kind": "plan", "file": "plan.json", "sha256": ""}
    (log := tmp_path / "wire.jsonl").write_text("\n".join([*lines, json.dumps(note)]) + "\n")
    for name, told in (("cell.toml", False), ("hoop/cell.toml", True)):
        options = ExportOptions("mcap", tmp_path / "a.mcap", cell=data_file(f"scenes/{name}"))
        export_file(log, options, Console())
        assert ("its arm or tool is not that of the log's plans" in capsys.readouterr().out) == told
