"""What numbers of a run depend on: derivatives, bands from tolerances, and how they are distributed."""
