"""What changed between two cells, calibrations or plans."""
