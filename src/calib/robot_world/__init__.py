"""Robot-world and hand-eye calibration from pairs of poses (AX = ZB)."""
