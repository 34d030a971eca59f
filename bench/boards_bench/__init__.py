"""Parts of bench/boards.py."""
