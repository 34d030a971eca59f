"""Products and angles that give the same bits on every processor."""
