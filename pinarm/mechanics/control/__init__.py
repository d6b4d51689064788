"""Controllers: what a drive does, from a reference and from what is measured. One kind is one module and one entry."""
