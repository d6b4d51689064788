"""Efforts of the drives of a mechanism, and the distribution of a load over redundant drives."""
