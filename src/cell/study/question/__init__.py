"""What a study asks: its file, the values of its points, and the files of each point."""
