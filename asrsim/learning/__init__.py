"""Iterative learning control."""
