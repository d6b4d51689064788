"""URDF and MJCF text to Pinocchio models."""
