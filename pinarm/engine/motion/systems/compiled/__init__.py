"""Systems whose steps the compiled kernel takes."""
