"""Calibration targets and the quality of their images."""
