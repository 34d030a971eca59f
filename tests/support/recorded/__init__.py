"""Recordings for calibrations, drawn from stated truths."""
