"""Motion over time: what is integrated, its segments between impacts, and the trajectory that comes out."""
