"""Calibration targets, and how well they are seen."""
