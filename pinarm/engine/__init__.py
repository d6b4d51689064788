"""Layer 2: the one equation of motion and its routes, assembly, time integration, and what comes out of them."""

import pinarm.mechanics  # noqa: F401  # loads Pinocchio, before a module of the engine does
