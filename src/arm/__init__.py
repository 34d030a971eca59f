"""What every room may know: robots, frames, value types, errors and data files. No devices, no clocks."""
