"""Distances between bodies, and the certificate that a whole motion keeps clear."""
