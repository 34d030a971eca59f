"""Certified motion planning, vision, calibration and execution for a CRS A465 arm on a MARS-8 controller."""
