"""Constraints as rows ``G v = 0``: closure, Jacobians, elimination, null space, multipliers."""
