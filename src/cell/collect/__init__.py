"""Collect a hand-eye recording: choose poses in view of the camera, and move the arm to them."""
