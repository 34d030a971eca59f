"""Programs as files: outlines, cells with a tool without jaws, and program files."""
