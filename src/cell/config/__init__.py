"""The cell file and its keys."""
