"""Sensitivity of numbers of a run: derivatives, bands from tolerances, and distributions."""
