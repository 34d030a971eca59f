"""Execution of plans: streaming, monitoring, pausing, slowing down."""
