"""`a465 study`: one question asked of many cells that differ in a few values."""
