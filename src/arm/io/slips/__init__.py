"""Slips of the hand in files: what a wrong value or line was rather meant to be."""
