"""Files: checked reading with errors that name the key, and atomic writing."""
