"""Images in, poses out: cameras, markers, boards."""
