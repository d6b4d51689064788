"""Layer 1: the vocabulary of mechanics: models, coordinates, motions, forces, drives."""
