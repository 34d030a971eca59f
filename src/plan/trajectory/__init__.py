"""Time parametrisation: joint paths, TOPP-RA, jerk limits, and integer segments for the controller."""
