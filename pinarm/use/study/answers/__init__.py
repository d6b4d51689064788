"""Answer keys: agreements, roundings and misprints told apart."""
