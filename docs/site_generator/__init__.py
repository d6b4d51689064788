"""Pages of the site that are made from the code, from example files and from results: see ``docs/site_hooks.py``."""
