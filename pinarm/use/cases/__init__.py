"""Many runs of one scenario: what varies from case to case, what is taken of each, and who solves them."""
