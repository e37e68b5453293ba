"""The MCAP log: written in bulk, read in bulk."""
