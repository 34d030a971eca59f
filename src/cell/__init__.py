"""The only package that knows all the others: command line, tasks, simulated cell, preview, reports."""

import arm.former  # noqa: F401  (former names are found)
