"""Formulas of named quantities: grammar, dimensions, evaluation."""
