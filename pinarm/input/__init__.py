"""Layer 0: what comes in from files: documents, units, formulas, model texts."""
