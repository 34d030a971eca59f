"""The verbs around calibration."""
