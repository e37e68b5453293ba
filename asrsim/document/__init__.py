"""Reads users' YAML documents against declared keys. The declarations also give the JSON Schema and the documentation."""
