"""Force elements: what acts on a mechanism besides gravity and its drives, one family a module."""
