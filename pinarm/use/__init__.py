"""Layer 4: what a person does with the program: run a scenario, look at its result, check it."""
