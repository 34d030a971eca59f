"""Parts that a program takes and puts down: as bodies of its scene, and as checked in its plans."""
