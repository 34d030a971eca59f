"""The whole chain in drawn worlds, from the lens to the tool in the holes, and its linear bound."""
