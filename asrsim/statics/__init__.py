"""Statics: positions at which torques balance, and whether springs and motors hold an arm."""
