"""Positions, velocities and accelerations under prescribed coordinates: Newton, continuation, mobility."""
