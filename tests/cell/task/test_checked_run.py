"""A run takes stock of its cubes."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import pytest

from arm.errors import ExecutionStopped
from cell.report.cubes import CubeRow
from cell.task.checked_run import CheckedRun
from vision.observation import Observation

TRANSFER = {"cube": "cube 01-02/3", "from": "01-02/3", "to": "03-04/1"}


def test_jaws_that_missed_a_cube_and_do_not_open_stop_the_run() -> None:
    """A retract with open jaws would be certified, but they are not open."""
    mars = SimpleNamespace(gripper=lambda closed: SimpleNamespace(stalled=True))
    run = CheckedRun.__new__(CheckedRun)
    run.connection, run.given_up, run.remarks = cast(Any, SimpleNamespace(mars=mars)), set(), []
    run.console = cast(Any, SimpleNamespace(step=lambda text: None))
    with pytest.raises(
        ExecutionStopped, match="missed the cube of 01-02/3 and do not open: something blocks them"
    ):
        run.missed(cast(Any, None), TRANSFER, CubeRow("01-02/3", "03-04/1"), Observation(), "on nothing")
