"""From data to samples: a scenario made ready, the steppings, the loop and its checks."""
