"""Vectors, placements of links, and chains between frames, at many configurations at once."""
