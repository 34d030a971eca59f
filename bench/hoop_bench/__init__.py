"""Parts of bench/hoop.py."""
