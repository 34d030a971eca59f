"""Bodies that follow from the cell file and from what was seen."""
