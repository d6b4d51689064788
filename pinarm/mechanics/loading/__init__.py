"""Readers of URDF, SDF and MJCF, and the Pinocchio model of what they read."""
