"""Cubes that are not in their seats."""
