"""Motions, searches and refusals of the planners in tests."""
