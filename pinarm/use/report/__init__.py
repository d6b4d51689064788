"""The report on results: one document for whoever asked the question."""
