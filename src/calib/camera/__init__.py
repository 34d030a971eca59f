"""A camera's intrinsics from images of a target: calibration, choice of views, validation, verdict."""
