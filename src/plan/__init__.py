"""Motion planning: from poses to certified plans, without cameras and controllers."""

import arm.former  # noqa: F401  (keeps former module names importable)
