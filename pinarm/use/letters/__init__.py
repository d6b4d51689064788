"""Equations of motion in the symbols of a mechanism, by SymPy."""
