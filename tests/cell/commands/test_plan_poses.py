"""What ``a465 plan`` of a list says beside its plan."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from typed.command_line import a465


@pytest.mark.parametrize(
    ("key", "angles", "told"),
    [
        ("q_deg", [-1.05, -0.7, -1.4, 0, -1.05, 0.1], True),
        ("q_rad", [-1.05, -0.7, -1.4, 0, -1.05, 0.1], False),
        ("q_rad", [0.011, 0.01, -0.01, 0, 0.01, 0.01], False),
        ("q_deg", [-60, -40.5, -80, 0, -60, 0], False),
    ],
)
def test_configurations_that_may_be_in_rad_are_told(
    key: str, angles: list[float], told: bool, scenes: Path, tmp_path: Path
) -> None:
    file = tmp_path / "list.json"
    file.write_text(
        json.dumps({"entries": [{key: [-60, -40, -80, 0, -60, 0]}] * (key == "q_deg") + [{key: angles}]})
    )
    said, _ = a465("plan", str(scenes / "cell.toml"), str(file), "-o", str(tmp_path / "plan.json"))
    assert (
        "NOTE: list.json: entries[1] = [-1.05, -0.7, -1.4, 0, -1.05, 0.1]: is it in rad? Then it" in said
    ) == told
    assert ("is it in rad" in said) == told
