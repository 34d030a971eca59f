"""Execution of plans on any controller: steps in order, monitoring, pausing, slowing down, stopping."""
