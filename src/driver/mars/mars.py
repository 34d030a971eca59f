"""A CRS A465 on a MARS-8 controller, as execution needs it: a session that can also follow a path."""

from __future__ import annotations

from collections.abc import Callable

from arm.controller.segments import CountPath
from driver.execution.control import Control
from driver.execution.progress import Progress, Sent, StreamOptions
from driver.mars.session import Session
from driver.mars.streaming.stream import stream


class Mars(Session):
    """One arm on one controller (`Session`); a `driver.execution.controller.Controller`."""

    def follow(
        self,
        path: CountPath,
        on_progress: Callable[[Progress], None] | None = None,
        options: StreamOptions | None = None,
        control: Control | None = None,
    ) -> Sent:
        """Stream a path; see `driver.mars.streaming.stream.stream`."""
        return stream(self, path, on_progress, options, control)
