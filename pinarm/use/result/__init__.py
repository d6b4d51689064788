"""What a run gives back, where on it a number is asked, and what was expected."""
