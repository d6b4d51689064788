"""Many runs or many looks at one: accuracy, sweeps, batches, answer keys, explanations."""
