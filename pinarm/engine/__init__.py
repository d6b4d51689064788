"""Layer 2: the one equation of motion and its routes, assembly, time integration, and what comes out of them."""
