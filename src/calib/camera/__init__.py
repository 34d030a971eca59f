"""Camera intrinsics from images of a target: calibration, view selection, cross-validation, verdict."""
