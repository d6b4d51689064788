"""Friction that sticks: how it and the reactions determine each other, when joints stick, slip and reverse."""
