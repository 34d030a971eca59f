"""Options that do not apply to a command as it is given are refused by their name, before anything is read."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import Any

import pytest

import cell.commands.emulate
from arm.errors import InputError
from cell.cli.main import app
from cell.cli.options import examples

EXECUTE, COLLECT = ("execute", "PLAN", "TASK"), ("calibrate", "hand-eye", "DATA", "--collect", "TASK")
NO_PLANNING = "needs --resume: executing a plan needs no search"
WITH_PORT = "cannot be combined with --port: it is for the simulated cell"
UNSEEN_PLAN = "needs --resume: a whole plan is executed by the code of its preview"
NO_PORT = "needs --port: the simulated cell asks for no confirmation"


@pytest.fixture(autouse=True)
def no_service(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let `a465 emulate` end at once instead of serving, should it accept an option."""
    monkeypatch.setattr(cell.commands.emulate, "emulate_step", lambda *_: None)


def _refused(*arguments: str) -> str:
    with pytest.raises(InputError) as refused:
        app([*arguments], standalone_mode=False)
    assert refused.value.data["option"] == str(refused.value).split()[0]
    return str(refused.value)


@pytest.mark.parametrize(
    ("arguments", "option", "rule"),
    [
        (EXECUTE, "--budget 1", NO_PLANNING),
        (EXECUTE, "--give-up 1", NO_PLANNING),
        (EXECUTE, "--yes CODE", NO_PORT),
        (EXECUTE, "--homed", NO_PORT),
        (EXECUTE, "--free", NO_PORT),
        ((*EXECUTE, "--resume"), "--unseen", NO_PORT),
        ((*EXECUTE, "--port", "P"), "--unseen", UNSEEN_PLAN),
        ((*EXECUTE, "--port", "P"), "--cell ideal", WITH_PORT),
        (("run", "TASK", "--port", "P"), "--cell mujoco", WITH_PORT),
        (("run", "TASK"), "--unseen", NO_PORT),
        (("run", "TASK"), "--homed", NO_PORT),
        (("run", "TASK"), "--free", NO_PORT),
        (COLLECT, "--unseen", NO_PORT),
        (COLLECT, "--homed", NO_PORT),
        (COLLECT, "--free", NO_PORT),
        (("emulate",), "--world W", "needs --task: there is no cell without it"),
        (("emulate",), "--photographs W", "needs --task: there is no cell without it"),
        (("emulate",), "--hand W", "needs --task: there is no cell without it"),
    ],
)
def test_an_option_that_needs_another_one_is_refused_without_it(
    arguments: tuple[str, ...], option: str, rule: str
) -> None:
    assert _refused(*arguments, *option.split()) == f"{option.split()[0]} {rule}"


@pytest.mark.parametrize("option", ["--images I", "--camera C", "--world W", "--picture P"])
def test_recorded_corners_need_no_images(option: str) -> None:
    told = _refused("look", "--detections", "D", *option.split())
    assert told == f"{option.split()[0]} cannot be combined with --detections, which needs no images"


@pytest.mark.parametrize(
    "option",
    [
        *("--target T", "--poses 9", "--recipe", "--seed 0", "--port P", "--world W", "--images I"),
        *("--camera C", "--speed 0.1", "--time-scale 1", "--unseen", "--homed", "--free"),
        *("--folder F", "--apply"),
    ],
)
def test_what_only_a_collection_needs_is_refused_without_one(option: str) -> None:
    told = _refused("calibrate", "hand-eye", "DATA", *option.split())
    assert told == f"{option.split()[0]} needs --collect TASK; without it, DATA is only read"


def test_the_recording_of_a_collection_is_beside_its_output(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    recorded: list[Path] = []

    def collected(files: Any, *_: Any) -> dict[str, Any]:
        recorded.append(files.recording)
        return {"reasons": []}

    monkeypatch.setattr("cell.commands.calibration.collect.collect_step", collected)
    whole = ["calibrate", "hand-eye", "--collect", "TASK", "-o", str(tmp_path / "made.toml")]
    app(whole, standalone_mode=False)
    app([*whole[:2], "own.json", *whole[2:]], standalone_mode=False)
    assert recorded == [tmp_path / "made.recorded.json", Path("own.json")]
    for some in (whole[:2], whole[:4], [*whole[:2], *whole[4:]]):
        with pytest.raises(
            InputError, match="DATA is missing: give the recording, or --collect TASK -o FILE"
        ):
            app(some, standalone_mode=False)


def test_an_example_in_a_help_text_is_the_same_command_when_it_is_wrapped() -> None:
    commands = (
        "a465 look x",
        f"a465 run {'y' * 50} --camera name:camera-crs93 --speed 0.1",
        f"a465 {'z' * 90}",
    )
    text = examples(*commands)
    assert max(map(len, examples(*commands[:2]).splitlines())) <= 78
    assert " --camera name:camera-crs93" in text
    pasted = text.partition("Examples:\n")[2].replace("\\\n", "").splitlines()
    assert [shlex.split(line) for line in pasted] == [command.split() for command in commands]
