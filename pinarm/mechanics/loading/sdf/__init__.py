"""Reader of SDF models, with the loops that they may have."""
