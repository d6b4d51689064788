"""A scenario: its file, its values, and what it finds before it is solved."""
