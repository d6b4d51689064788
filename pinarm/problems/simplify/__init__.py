"""Simplified mechanisms: joints that a problem does not need are locked, and the outcome is that of the whole."""
