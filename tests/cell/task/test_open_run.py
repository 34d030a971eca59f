"""What all stages of a run share, where it decides: a first look that shows too little."""

from __future__ import annotations

from itertools import count
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest

from arm.errors import ImpossibleError
from cell.console import Console
from cell.task.open_run import OpenRun
from vision.background.camera_shift import UNRECOGNISED


@pytest.mark.parametrize(("reason", "goes_on"), [(UNRECOGNISED, True), ("moved", False)])
def test_a_hidden_background_waits_for_q_start_and_a_moved_camera_does_not(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], reason: str, goes_on: bool
) -> None:
    def refused(self: OpenRun, why: str) -> None:
        raise ImpossibleError("the camera", reason=reason)

    monkeypatch.setattr(OpenRun, "see", refused)
    run = OpenRun.__new__(OpenRun)
    run.console = Console()
    if goes_on:
        assert run.try_look("before anything moves") is None
        assert "checked from q_start" in capsys.readouterr().out
    else:
        with pytest.raises(ImpossibleError):
            run.try_look("before anything moves")


def test_a_remark_on_the_camera_names_its_look(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Six looks, six remarks: nobody knows otherwise which image a remark is about."""
    seen = SimpleNamespace(images=[None], camera_shift=None)
    monkeypatch.setattr("cell.task.open_run.look_and_save", lambda *_: seen)
    monkeypatch.setattr("cell.task.open_run.shift_words", lambda _: "the camera has moved")
    run = OpenRun.__new__(OpenRun)
    run.console, run.folder, run.pictures, run.remarks, run.photographs = Console(), tmp_path, [], [], None
    run._looks, run.task = count(1), cast(Any, None)
    run.connection = cast(Any, SimpleNamespace(mars=SimpleNamespace(note=lambda *_, **__: None), frames=None))
    for _ in range(2):
        run.see("after a cube")
    assert run.remarks == ["look 1: the camera has moved", "look 2: the camera has moved"]
    assert [picture.file.name for picture in run.pictures] == ["look-1.png", "look-2.png"]
