"""Layer 4: what a person does with the program: run a scenario, look at its result, check it."""

import pinarm.mechanics  # noqa: F401  # loads Pinocchio and numpy, before a module here does
