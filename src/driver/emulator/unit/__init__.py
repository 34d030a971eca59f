"""The emulated unit itself: axes, path generator, limits, and the plant that it moves."""
