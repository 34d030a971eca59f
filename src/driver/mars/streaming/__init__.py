"""Paths on a MARS-8: segments are streamed, their echo is checked, the motion is monitored."""
