"""Robot-world and hand-eye from pairs of poses, AX = ZB."""
