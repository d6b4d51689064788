"""Which efforts of the drives hold a mechanism, and where it is in equilibrium without any."""
