"""The equation of motion, its one constrained solve, and the faster routes that are tested against it."""
