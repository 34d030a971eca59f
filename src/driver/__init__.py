"""Driver of the MARS-8 controller: protocol, streaming of plans, monitoring, and an emulated controller."""

import arm.former  # noqa: F401  (former names still work)
