"""Layer 0: readers of files: documents, units, formulas, model texts."""
