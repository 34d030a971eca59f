"""Plan in, bytes out: the MARS-8 protocol, streaming, monitoring, and an emulated controller."""

import arm.former  # noqa: F401  (former names are found)
