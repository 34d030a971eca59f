"""Recordings that calibrations read."""
