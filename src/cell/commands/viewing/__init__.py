"""Places shown on pages while something happens there."""
