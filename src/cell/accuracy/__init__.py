"""Predicted errors of placements: what each source contributes, and the chance that a cube enters its pocket."""
