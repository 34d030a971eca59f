"""Tasks, scenes and whole runs."""
