"""An emulated unit, and parts of one, in tests."""
