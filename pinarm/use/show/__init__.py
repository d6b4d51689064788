"""Plots, sketches, tables and replays of results."""
