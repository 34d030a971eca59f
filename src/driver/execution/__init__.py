"""A plan is executed: streamed, watched, paused, slowed down."""
