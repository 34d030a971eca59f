"""Doubts about a cell: values that the rules of its keys allow, and that are rather meant in another unit or place."""
