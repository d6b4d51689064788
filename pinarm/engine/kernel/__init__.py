"""Compiled code, in C, for the steps of forward motions: where it is missing, the same is computed in Python."""
