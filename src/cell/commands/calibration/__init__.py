"""Implementation of the calibration commands."""
