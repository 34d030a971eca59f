"""Parts of bench/anyarm.py."""
