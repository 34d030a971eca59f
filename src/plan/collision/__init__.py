"""Distances between bodies, and certificates of clearance over whole motions."""
