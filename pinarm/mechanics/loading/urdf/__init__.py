"""Reader and writer of URDF models."""
