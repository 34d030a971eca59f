"""The live view: a web page that follows a run."""

from typing import TYPE_CHECKING

from arm.former import FormerNames

if not TYPE_CHECKING:
    __getattr__ = FormerNames(__name__, "cell.live.view", "Live", "live_view")
