"""Batches: one scenario from many initial states."""
