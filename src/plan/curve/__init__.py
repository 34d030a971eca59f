"""Curves of the tool: a path of poses with free directions becomes a path of the joints."""
