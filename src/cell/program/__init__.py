"""Programs as files: paths, poses and joints on a work, read from TOML."""
