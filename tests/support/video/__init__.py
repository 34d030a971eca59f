"""Stand-ins for video devices."""
