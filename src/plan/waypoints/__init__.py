"""Lists of poses and configurations."""
