"""The benchmark of pinarm against other engines: see ``benchmarks/results/race.md``."""
