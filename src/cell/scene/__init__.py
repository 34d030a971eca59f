"""Collision bodies from the cell file and from looks."""
