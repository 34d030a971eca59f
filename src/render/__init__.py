"""A synthetic camera: bodies and boards to grey images, with the lens that the calibration describes."""
