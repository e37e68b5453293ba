"""Documents of users: YAML with a line for every value, read against declared keys that also make schema and docs."""
