"""Boards: arrangement of their markers, pose, and uncertainty of the pose."""
