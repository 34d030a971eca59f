"""A second look at the target while the cube is above its pocket, and what follows from it."""
