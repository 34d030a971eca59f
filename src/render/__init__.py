"""A synthetic camera: renders bodies and boards to grey images, with the distortion of a calibrated camera."""
