"""Shared by all packages: robots, frames, value types, errors and data files. No devices, no clocks."""

import arm.former  # noqa: F401  (keeps former module names importable)
