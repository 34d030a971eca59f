"""Boards: their markers' arrangement, their pose, and how certain it is."""
