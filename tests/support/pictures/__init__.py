"""Boards, holes, cubes and targets as images show them, with the truth."""
