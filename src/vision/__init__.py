"""Images in, poses out: cameras, markers, boards."""

import arm.former  # noqa: F401  (former names are found)
