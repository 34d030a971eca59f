"""Cells and tables whose background a camera is watched on."""
