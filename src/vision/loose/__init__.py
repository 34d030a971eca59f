"""The pose of a cube that is not properly seated: beside its hole, on the rim, leaning in its pocket, or too high."""
