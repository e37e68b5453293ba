"""Runs scripts on untrusted files, each in a separate process with limited time and memory."""
