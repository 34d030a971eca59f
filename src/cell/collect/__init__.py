"""Collecting a hand-eye recording: poses that the camera sees, and the arm that goes there."""
