"""Pages of refusals."""
