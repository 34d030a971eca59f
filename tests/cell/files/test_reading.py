"""What options say of a list's numbers, and a list that says otherwise."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from arm.errors import FileInputError, InputError
from cell.files.pose_list import read_pose_list
from cell.files.reading import Reading, reading_of


def test_options_have_known_values() -> None:
    assert reading_of(None, "deg", None) == Reading(None, "deg", "m", options=("angles",))
    with pytest.raises(InputError, match=r"^--frame hand: must be one of flange, tool$"):
        reading_of("hand", None, None)


@pytest.mark.parametrize(
    ("stated", "options"),
    [
        ({"angles": "rad"}, (None, "deg", None)),
        ({"frame": "tool"}, ("flange", None, None)),
        ({"lengths": "mm"}, (None, None, "m")),
    ],
)
def test_a_list_that_states_otherwise_is_refused(
    tmp_path: Path, stated: dict[str, str], options: tuple[str | None, ...]
) -> None:
    file, ((name, value),) = tmp_path / "q.json", stated.items()
    file.write_text(json.dumps({**stated, "entries": [{"q_rad": [0.1] * 6}]}))
    other = next(filter(None, options))
    with pytest.raises(FileInputError, match=f"{name} = '{value}': differs from --{name} {other} "):
        read_pose_list(file, reading_of(*options))
    assert read_pose_list(file, Reading("flange", "deg", "m")).entries  # of a command, not of a person
    same = {"frame": None, "angles": None, "lengths": None, **stated}
    assert read_pose_list(file, reading_of(*same.values())).entries
