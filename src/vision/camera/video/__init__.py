"""Cameras that OpenCV opens: devices, network streams, and recordings."""
