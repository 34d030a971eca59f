"""Poses in, checked plan out. Never sees a camera or a port."""

import arm.former  # noqa: F401  (former names are found)
