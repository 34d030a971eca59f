"""What every room may know: robots, frames, value types, errors and data files. No devices, no clocks."""

import arm.former  # noqa: F401  (former names are found)
