"""Cases of a sweep that are solved together as one array."""
