"""Linear analysis: derivatives of the equation of motion, linearised motion, natural frequencies and mode shapes."""
