"""First steps of a user: examples, templates, the first files of a model."""
