"""What `bench/mutants.py` runs: lists of mutants, how they are drawn, and the tests that are to see them."""
