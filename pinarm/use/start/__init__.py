"""What a user begins with: examples, templates, the first files of a model."""
