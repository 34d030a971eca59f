"""Solutions of goals in a given order, chosen together."""
