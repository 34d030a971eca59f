"""What all stages of a run share, where it decides: a first look that shows too little."""

from __future__ import annotations

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
