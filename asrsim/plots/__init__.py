"""Figures, drawn from logs and recordings only."""
