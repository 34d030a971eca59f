"""Cubes beside the plan: is one where it should be, where is it instead, and how it gets there."""
