"""Vision: cameras, markers, boards and cubes in images."""

import arm.former  # noqa: F401  (former names are found)
