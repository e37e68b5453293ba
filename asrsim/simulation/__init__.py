"""From data to samples: build, steppings, the loop."""
