"""The live view: a web page that follows a run."""

from arm.former import former_names

former_names(__name__, "cell.live.view", "Live", "live_view")
