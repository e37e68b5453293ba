"""The scenario as pure data: YAML read and validated."""
