"""Boards before a camera whose outlines are not square."""
