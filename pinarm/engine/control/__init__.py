"""Controllers in a forward motion: what they remember, when they act, and what of them is integrated."""
