"""Motions that are given as rows: measured, or computed elsewhere."""
