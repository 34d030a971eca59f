"""Recordings that calibrations are made from."""
