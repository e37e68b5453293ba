"""Runs scripts on untrusted files, each in a process of its own with limited time and memory."""
