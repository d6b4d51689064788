"""What rows leave free and what they hold, of dense, sparse and many matrices."""
