"""Result of a run: its numbers, their places on the run, and their expected values."""
