"""Measures of accuracy by routes that the solver did not use: energy, power, residuals, singular positions, limits."""
