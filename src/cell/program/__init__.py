"""Programs as files: paths, poses and joints on a workpiece, read from TOML."""
