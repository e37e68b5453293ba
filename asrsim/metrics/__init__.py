"""Numbers that judge a run: pure functions on arrays."""
