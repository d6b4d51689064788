"""The benchmark of pinarm against other engines: see ``docs/race.md``."""
