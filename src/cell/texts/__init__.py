"""Texts of the keys of all files: comments of new files, rows of docs/formats.md."""
