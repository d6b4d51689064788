"""Figures of curves: integrals, extremes, crossings, percentiles, with their errors."""
