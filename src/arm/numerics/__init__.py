"""Linear algebra and angles with the same bits on every processor."""
