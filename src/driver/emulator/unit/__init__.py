"""The emulated unit: axes, path generator, limits, gripper, records."""
