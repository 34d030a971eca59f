"""The narrow phase: shapes as coal has them, and the distances of a torus, which it does not have."""
